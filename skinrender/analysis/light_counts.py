"""Light that leaves the skin, counted round by round: nothing is stored, no camera looks.

The histories of each band are settled by a pilot with a seed of its own, before the first one that counts: a run that
ended when its own error looks small would favor rounds that happen to agree.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from skinrender.engine.executor import in_order
from skinrender.engine.interrupt import listen
from skinrender.engine.ledger import check_counts
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.volume import SkinVolume
from skinrender.transport import tally

ROUNDS = 64
"""Batches for the standard errors: each is known to 9 %."""
PILOT_ROUNDS = 32
PILOT_HISTORIES = 96
"""Of a band in a round."""


@dataclass(frozen=True, eq=False)
class LightCounts:
    """What became of the light in n rounds; B bands, T tally columns, R regions.

    Parameters
    ----------
    histories : (B,) in each round.
    tallies : (n, B, T), columns of `transport.tally`.
    exits : (n, B, R), photons that had entered and left upwards through each region.
    """

    histories: np.ndarray
    tallies: np.ndarray
    exits: np.ndarray


@dataclass(frozen=True, eq=False)
class _CountRound:
    """One round's work; its photons are told apart by the region of the patch they leave through."""

    photon_pass: PhotonPass
    histories: np.ndarray
    regions: Sequence[np.ndarray]

    def __call__(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        exits = [] if self.regions else None
        walked = self.photon_pass.walk(index, self.histories, False, exits)
        check_counts(walked)
        by_region = np.zeros((len(self.histories), len(self.regions)), np.int64)
        for band, left in zip(np.flatnonzero(self.histories), exits or ()):
            by_region[band] = [region[self._columns(left)].sum() for region in self.regions]
        return walked.tallies, by_region

    def _columns(self, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Voxel columns (ix, iy) through which photons left."""
        volume = self.photon_pass.volume
        counts = volume.shape[:2]
        return tuple(
            np.floor(left[:, axis] * (counts[axis] / volume.size_mm[axis])).astype(np.int64) % counts[axis]
            for axis in (0, 1)
        )


def count_rounds(
    photon_pass: PhotonPass,
    histories: np.ndarray,
    rounds: int,
    *,
    regions: Sequence[np.ndarray] = (),
    workers: int | None = None,
    progress: bool = False,
) -> LightCounts:
    """Walk rounds, on threads, and count.

    Parameters
    ----------
    histories : (B,) in each round.
    regions : (nx, ny) bool each; columns whose light is counted apart.
    workers : threads; by default one a core. The counts do not depend on it.
    """
    work = _CountRound(photon_pass, np.asarray(histories, np.int64), tuple(regions))
    threads = workers or os.cpu_count() or 1
    tallies, exits = [], []
    hide = None if progress else True
    with listen() as interrupt, tqdm(total=rounds, unit=" rounds", disable=hide, desc="spectrum", leave=False) as bar:
        results = in_order(
            work, range(rounds), workers=threads, check=interrupt.check,
            open_executor=(lambda: ThreadPoolExecutor(threads)) if threads > 1 else None,
        )  # fmt: skip
        with closing(results):
            for of_bands, of_regions in results:
                tallies.append(of_bands)
                exits.append(of_regions)
                bar.update()
    return LightCounts(work.histories, np.array(tallies), np.array(exits))


def settle_histories(photon_pass: PhotonPass, stderr: float) -> np.ndarray:
    """Histories (B,) of a round, so that `ROUNDS` of them give the reflectance to `stderr`.

    Parameters
    ----------
    photon_pass : made with the seed of the pilot.
    stderr : relative standard error wanted, mean over the bands.

    Notes
    -----
    With relative variance v and c scattering events a history, N ~ v^(1/3) c^(-2/3) reaches the mean error with the
    fewest events (J. Neyman, J. R. Stat. Soc. 97, 558 (1934), with unequal costs). v is binomial, (1 - R)/R, times the share that
    the control variate leaves, which is pooled over the bands: in a single one the pilot does not know it.
    """
    bands = photon_pass.bands
    pilot = count_rounds(photon_pass, np.full(bands, PILOT_HISTORIES), PILOT_ROUNDS, workers=1)
    layers = len(photon_pass.layer_names)
    counts = pilot.tallies.sum(axis=0)
    walked = PILOT_ROUNDS * PILOT_HISTORIES
    reflectance = np.maximum(counts[:, tally.REFLECTED], 3) / walked  # 3: upper end of what none in n may mean
    events = 1.0 + counts[:, tally.scattered(layers)].sum(axis=1) / walked
    variance = (1.0 - np.minimum(reflectance, 1.0 - 1.0 / walked)) / reflectance * _share_left(photon_pass.volume, pilot)
    weight = np.cbrt(variance / events**2)
    scale = (np.sqrt(variance / weight).mean() / stderr) ** 2
    return np.ceil(scale * weight / ROUNDS).astype(np.int64)


def balance(volume: SkinVolume, counts: LightCounts) -> np.ndarray:
    """Photons absorbed less those expected to be, given the collisions that they made; per history, (n, B), mean 0.

    At a collision a photon is absorbed with probability mu_a/mu_t whatever came before, so over layers of one
    coefficient, whose collisions the tally tells, the difference is a martingale. Layers that a macule made uneven are
    left out.
    """
    layers = len(volume.layer_name) - 1
    absorbed, scattered = (counts.tallies[..., of(layers)] for of in (tally.absorbed, tally.scattered))
    probability = np.zeros((layers, len(volume.wavelength_nm)))
    even = np.zeros(layers, bool)
    for i in range(layers):
        mu_a, mu_s = (np.unique(mu[volume.palette_layer == i + 1], axis=0) for mu in (volume.mu_a, volume.mu_s))
        even[i] = len(mu_a) == len(mu_s) == 1
        if even[i]:
            mu_t = mu_a[0] + mu_s[0]
            probability[i] = np.divide(mu_a[0], mu_t, out=np.zeros_like(mu_t), where=mu_t > 0)
    unexpected = absorbed - probability.T * (absorbed + scattered)
    return unexpected[..., even].sum(axis=-1) / counts.histories


def controlled_mean(values: np.ndarray, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over rounds with a control variate of known mean 0, and its covariance.

    S. S. Lavenberg, T. L. Moeller, P. D. Welch, Oper. Res. 30, 182 (1982).

    Parameters
    ----------
    values : (n, B, K), one of n independent rounds a row.
    control : (n, B).

    Returns
    -------
    mean : (B, K).
    covariance : (B, K, K) of the means.
    """
    rounds = len(values)
    away = control - control.mean(axis=0)
    squares = (away**2).sum(axis=0)
    inverse = np.divide(1.0, squares, out=np.zeros_like(squares), where=squares > 0)
    slope = np.einsum("nb,nbk->bk", away, values) * inverse[:, None]
    offset = control.mean(axis=0)
    mean = values.mean(axis=0) - slope * offset[:, None]
    residual = values - values.mean(axis=0) - slope * away[..., None]
    spread = np.einsum("nbj,nbk->bjk", residual, residual) / (rounds - 2)
    return mean, spread * (1.0 / rounds + offset**2 * inverse)[:, None, None]


def _share_left(volume: SkinVolume, pilot: LightCounts) -> float:
    """Share of the variance of the reflectance that remains beside the control variate, mean over the bands."""
    reflected = pilot.tallies[..., tally.REFLECTED, None] / pilot.histories[:, None]
    plain = reflected[..., 0].var(axis=0, ddof=1) / len(reflected)
    _, left = controlled_mean(reflected, balance(volume, pilot))
    varies = plain > 0
    return float(min(1.0, left[varies, 0, 0].sum() / plain[varies].sum())) if varies.any() else 1.0
