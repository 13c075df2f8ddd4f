"""Light that comes back from flat layers without absorption, and how far it went in each: any absorption can be laid on.

A photon whose path lengths in the layers are l comes back with the probability exp(-Σ μa l) once the layers absorb, and how
it is scattered does not depend on that: one walk gives the reflectance for every content of chromophores (the white
Monte Carlo of A. Kienle and M. S. Patterson, Phys. Med. Biol. 41, 2221 (1996)). Inner borders are matched, as in skin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from skinrender.analysis.spectrum import INCIDENCE_DEG
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume


class Paths(NamedTuple):
    """Photons of one band that came back.

    Parameters
    ----------
    length_mm : (N, L) in each layer, top to bottom.
    launched : photons aimed at the surface.
    specular : share of them that never entered.
    """

    length_mm: np.ndarray
    launched: float
    specular: float

    def reflectance(self, mu_a_per_mm: np.ndarray) -> float:
        """Specular included, of layers that absorb (L,)."""
        kept = np.exp(-self.length_mm @ np.asarray(mu_a_per_mm, np.float32))
        return self.specular + float(kept.sum(dtype=float)) / self.launched


def volume_paths(volume: SkinVolume, photons: int, seed: int) -> list[Paths]:
    """Paths of each band through a flat volume, one content a layer, lit as by `skinrender.spectrum`."""
    first = [int(np.argmax(volume.palette_layer == layer)) for layer in range(1, len(volume.layer_name))]
    index = regions_of(volume).index[1]
    return [
        _band_paths(volume.border_z_mm, volume.mu_s[first, band], volume.g[first, band], float(n), photons, (seed, band))
        for band, n in enumerate(index)
    ]


def _band_paths(
    borders_mm: np.ndarray, mu_s: np.ndarray, g: np.ndarray, index: float, photons: int, seed: tuple[int, int]
) -> Paths:
    """Paths through layers of one refractive index under air."""
    cosine = math.cos(math.radians(INCIDENCE_DEG))
    specular = _fresnel(cosine, 1.0, index)
    inside = math.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    length = np.zeros((photons, len(mu_s)), np.float32)
    came_back = _walk(borders_mm, mu_s, g, index, inside, np.random.default_rng(seed), length)
    # All that are walked enter; each stands for 1/(1 - specular) that were aimed.
    return Paths(length[:came_back], photons / (1.0 - specular), specular)


@numba.njit
def _fresnel(cosine, n_from, n_to):
    """Unpolarized Fresnel reflectance."""
    sine2 = (1.0 - cosine * cosine) * (n_from / n_to) ** 2
    if sine2 >= 1.0:
        return 1.0
    beyond = math.sqrt(1.0 - sine2)
    s = (n_from * cosine - n_to * beyond) / (n_from * cosine + n_to * beyond)
    p = (n_from * beyond - n_to * cosine) / (n_from * beyond + n_to * cosine)
    return 0.5 * (s * s + p * p)


@numba.njit
def _turned(rng, uz, g):
    """Vertical cosine after a scattering by Henyey and Greenstein; the azimuth about the old direction is even."""
    ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * rng.random())
    cosine = (1.0 + g * g - ratio * ratio) / (2.0 * g)
    across = math.sqrt(max(0.0, (1.0 - cosine * cosine) * (1.0 - uz * uz)))
    return min(1.0, max(-1.0, uz * cosine + across * math.cos(2.0 * math.pi * rng.random())))


@numba.njit
def _walk(borders, mu_s, g, index, uz_first, rng, length):
    """Fill the rows of the photons that come back; their number."""
    row = 0
    for _ in range(length.shape[0]):
        length[row] = 0.0
        layer, z, uz = 0, 0.0, uz_first
        while layer < mu_s.size:
            free = -math.log(1.0 - rng.random()) / mu_s[layer]
            edge = borders[layer + 1] if uz > 0.0 else borders[layer]
            if free * abs(uz) < abs(edge - z):
                z += free * uz
                length[row, layer] += free
                uz = _turned(rng, uz, g[layer])
                continue
            length[row, layer] += abs((edge - z) / uz)
            z = edge
            if layer == 0 and uz < 0.0:
                if rng.random() >= _fresnel(-uz, index, 1.0):
                    row += 1
                    break
                uz = -uz
            else:
                layer += 1 if uz > 0.0 else -1
    return row
