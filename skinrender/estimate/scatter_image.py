"""What an estimate of the multiply scattered light gives, with its noise from independent batches of rounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_BATCHES = 20


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
    """

    radiance: np.ndarray
    batch_y: np.ndarray
    batch_radiance: np.ndarray
    batch_rounds: np.ndarray
    gathered: float


def batches_of(rounds: int) -> list[np.ndarray]:
    """Rounds in at most `MOST_BATCHES` batches of nearly equal size."""
    return [part for part in np.array_split(np.arange(rounds), min(rounds, MOST_BATCHES)) if part.size]


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
