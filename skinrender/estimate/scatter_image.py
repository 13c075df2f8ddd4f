"""What an estimate of the multiply scattered light gives, with its noise from independent batches of rounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skinrender.estimate.guide import Flattened, restore

MOST_BATCHES = 20
MOST_POOLED = 64


@dataclass(frozen=True, eq=False)
class ScatteredLight:
    """Radiance of multiply scattered light at the rays of a lattice.

    Parameters
    ----------
    radiance : (h, w, B) f4 outside the skin, W mm^-2 sr^-1 in the band.
    batch_y : (batches, h, w) f4, luminance of each batch on its own.
    batch_radiance : (batches,) mean radiance over the rays, summed over bands, of each batch.
    batch_rounds : (batches,) rounds in each.
    gathered : photons that met a ray, on average.
    remaining : of the reference, what may still be wrong with its mean, relative, by name: (value, standard error).
    """

    radiance: np.ndarray
    batch_y: np.ndarray
    batch_radiance: np.ndarray
    batch_rounds: np.ndarray
    gathered: float
    remaining: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class BandsLight:
    """What the photons of some bands show: bands are independent, so they can be estimated apart and joined.

    Parameters
    ----------
    bands : (n,) their numbers, ascending.
    radiance : (h, w, n) f4, W mm^-2 sr^-1 in the band.
    luminance : (h, w, n) f8 or None, luminance of each band where it is known better than by `radiance`.
    batch_y : (batches, h, w) f4, what each batch adds to the luminance.
    batch_sum : (batches,) what each batch adds to the radiance, summed over pixels and bands.
    met : photons that met a ray.
    flattened : of a beam estimate where guides are known, see `guide`.
    batch_sum_finer : of a reference, `batch_sum` of some batches through a finer mesh.
    """

    bands: np.ndarray
    radiance: np.ndarray
    luminance: np.ndarray | None
    batch_y: np.ndarray
    batch_sum: np.ndarray
    met: float
    flattened: Flattened | None = None
    batch_sum_finer: np.ndarray | None = None


def joined(parts: Sequence[BandsLight], rounds: int, y_weight: np.ndarray) -> ScatteredLight:
    """The light of all bands; y_weight: (B,) luminance of one W mm^-2 sr^-1 in each.

    Where the luminance is known better than the radiance, each pixel's spectrum is scaled to it; what a kernel has
    flattened is restored where guides are known.
    """
    h, w = parts[0].radiance.shape[:2]
    radiance = np.zeros((h, w, len(y_weight)), np.float32)
    for part in parts:
        radiance[:, :, part.bands] = part.radiance
    luminance = radiance @ y_weight
    if parts[0].luminance is not None:
        better = sum(part.luminance[:, :, k] for part in parts for k in range(len(part.bands)))
        radiance *= np.divide(better, luminance, out=np.ones_like(better), where=luminance > 0.0)[:, :, None]
        luminance = better
    sizes = np.array([len(batch) for batch in batches_of(rounds)])
    scale = rounds / sizes
    batch_y = np.sum([part.batch_y for part in parts], axis=0) * scale[:, None, None]
    if parts[0].flattened is not None:
        noisy = sum(part.flattened.noisy for part in parts)
        restoration = restore(luminance, noisy, parts[0].flattened.changes)
        batches = np.sum([part.flattened.batches for part in parts], axis=0, dtype=np.float64) * scale[:, None, None]
        batch_y = np.array([restoration.batch(*pair) for pair in zip(batch_y, batches)])
        radiance *= restoration.factor[:, :, None].astype(np.float32)
    batch_sum = np.sum([part.batch_sum for part in parts], axis=0)
    met = sum(part.met for part in parts)
    return ScatteredLight(radiance, batch_y.astype(np.float32), batch_sum * scale / (h * w), sizes, met / (h * w))


def batches_of(rounds: int) -> list[np.ndarray]:
    """Rounds in at most `MOST_BATCHES` batches of nearly equal size."""
    return [part for part in np.array_split(np.arange(rounds), min(rounds, MOST_BATCHES)) if part.size]


def pooled(a: ScatteredLight, b: ScatteredLight) -> ScatteredLight:
    """The light of two sets of rounds, one after the other; batches are joined in pairs when they grow many."""
    share = b.batch_rounds.sum() / (a.batch_rounds.sum() + b.batch_rounds.sum())
    joined = ScatteredLight(
        a.radiance + np.float32(share) * (b.radiance - a.radiance),
        np.concatenate([a.batch_y, b.batch_y]),
        np.concatenate([a.batch_radiance, b.batch_radiance]),
        np.concatenate([a.batch_rounds, b.batch_rounds]),
        a.gathered + b.gathered,
        {name: _mean_pair(value, b.remaining[name], share) for name, value in a.remaining.items()},
    )
    return joined if len(joined.batch_rounds) <= MOST_POOLED else _halved(joined)


def _mean_pair(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    return (1 - share) * a[0] + share * b[0], float(np.hypot((1 - share) * a[1], share * b[1]))


def _halved(light: ScatteredLight) -> ScatteredLight:
    """With half as many batches, each of two neighbors (an odd last one stays)."""
    starts = np.arange(0, len(light.batch_rounds), 2)
    rounds = np.add.reduceat(light.batch_rounds, starts)

    def means(values: np.ndarray) -> np.ndarray:
        weight = light.batch_rounds.reshape((-1,) + (1,) * (values.ndim - 1))
        sums = np.add.reduceat(values * weight, starts, axis=0)
        return (sums / rounds.reshape((-1,) + (1,) * (values.ndim - 1))).astype(values.dtype)

    return replace(light, batch_y=means(light.batch_y), batch_radiance=means(light.batch_radiance), batch_rounds=rounds)


def batch_stderr(values: np.ndarray, rounds: np.ndarray) -> np.ndarray:
    """Standard error of the mean of batches (batches, ...) whose variance falls with their number of rounds.

    Infinite for a single batch.
    """
    if len(values) < 2:
        return np.full(values.shape[1:], np.inf)
    weight = rounds / rounds.sum()
    shape = (-1,) + (1,) * (values.ndim - 1)
    mean = np.sum(weight.reshape(shape) * values, axis=0, dtype=np.float64)
    spread = np.sum(weight.reshape(shape) * (values - mean) ** 2, axis=0, dtype=np.float64)
    return np.sqrt(spread / (len(values) - 1))
