"""Roulette on storage: deep photons that no view ray can see need not be stored.

A photon at optical depth tau shows with the transmittance exp(-tau). It is kept with a probability that falls with the
transmittance and weighs the reciprocal, looked up from the same table: unbiased at every depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinrender.skin.volume import SkinVolume

FULL_DEPTH = 1.0
"""Optical depth down to which every photon is kept; below, all show equally."""
LEAST = 1e-6
BIN_MM = 0.005
MAX_BINS = 1000
_WORD = 2.0**32


@dataclass(frozen=True, eq=False)
class DepthTable:
    """Keep probabilities by band and depth below the top of the volume; None keeps all.

    Parameters
    ----------
    keep_probability : (B, D) f4 or None; whole multiples of 2^-32, as one word decides.
    depth_edges_mm : (D + 1,) equidistant, z of the scene; the last bin holds all that is deeper.
    """

    keep_probability: np.ndarray | None
    depth_edges_mm: np.ndarray | None

    @cached_property
    def thresholds(self) -> tuple[float, np.ndarray] | None:
        """What `storing.roll` reads: bins per mm, and the largest words that keep."""
        if self.keep_probability is None:
            return None
        largest = self.keep_probability.astype(np.float64) * _WORD - (0.5 * _WORD + 1.0)
        return 1.0 / float(self.depth_edges_mm[1] - self.depth_edges_mm[0]), largest.astype(np.int32)


def keep_all(volume: SkinVolume) -> DepthTable:
    """Every photon is stored."""
    return DepthTable(None, None)


def keep_visible(volume: SkinVolume) -> DepthTable:
    """Keep in proportion to the transmittance of the clearest vertical way up, all within `FULL_DEPTH`; all there is if it goes no deeper."""
    mu_t = volume.mu_a + volume.mu_s
    clearest = np.array([mu_t[held].min(axis=0) for held in volume.plane_holds])
    z = volume.z_edges_mm
    depth = np.concatenate([np.zeros((1, mu_t.shape[1])), np.cumsum(clearest * np.diff(z)[:, None], axis=0)])
    bins = int(np.clip(np.ceil((z[-1] - z[0]) / BIN_MM), 1, MAX_BINS))
    edges = np.linspace(z[0], z[-1], bins + 1)
    # at the upper edge of a bin, where its photons show most
    tau = np.array([np.interp(edges[:-1], z, depth[:, band]) for band in range(mu_t.shape[1])])
    keep = np.rint(np.clip(np.exp(FULL_DEPTH - tau), LEAST, 1.0) * _WORD) / _WORD
    if keep.min() == 1.0:
        return keep_all(volume)
    return DepthTable(keep.astype(np.float32), edges)
