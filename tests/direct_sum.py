"""Radiance estimates as direct sums over all photons and rays, in plain numpy, to compare the fast ones with.

For parallel or pinhole rays on a flat surface over periodic tissue of one refractive index and one g.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skinrender.photonmap.photon_map import PhotonMap
from skinrender.skin.volume import SkinVolume


class Photons(NamedTuple):
    """Photons of one band: (n, 3) mm, (n, 3) flight, (n,) W times weight."""

    position: np.ndarray
    direction: np.ndarray
    power: np.ndarray


class Rays(NamedTuple):
    """View rays: (Q, 2) entry mm, (Q, 3) direction inside, (Q,) factor (1 - F) / n^2."""

    entry: np.ndarray
    direction: np.ndarray
    transmission: np.ndarray


def directions(code: np.ndarray) -> np.ndarray:
    """Unit vectors of octahedral codes (n, 2)."""
    x, y = ((code.astype(float) + 0.5 - 32768.0) / 32767.0).T
    z = 1.0 - abs(x) - abs(y)
    folded = np.where(z < 0.0, (1.0 - abs(y)) * np.copysign(1.0, x), x), np.where(z < 0.0, (1.0 - abs(x)) * np.copysign(1.0, y), y)
    vectors = np.column_stack([*folded, z])
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def photons_of(photon_map: PhotonMap, deepest_mm: float, band: int = 0) -> Photons:
    """Photons above a depth, with what roulette makes them stand for."""
    chosen = (photon_map.band == band) & (photon_map.position[:, 2] < deepest_mm)
    position = photon_map.position[chosen].astype(float)
    weight = np.ones(len(position))
    if photon_map.keep_probability is not None:
        keep, edges = photon_map.keep_probability[band], photon_map.depth_edges_mm
        weight = 1.0 / keep[np.clip(np.searchsorted(edges, position[:, 2], side="right") - 1, 0, len(keep) - 1)]
    return Photons(position, directions(photon_map.direction[chosen]), photon_map.power_per_band[band] * weight)


def rays_of(origin: np.ndarray, direction: np.ndarray, n: float) -> Rays:
    """View rays (h, w, 3) refracted by Snell's law into a flat medium of index n below air."""
    origin, direction = origin.reshape(-1, 3), direction.reshape(-1, 3)
    entry = origin - direction * (origin[:, 2:] / direction[:, 2:])
    outside = direction[:, 2]
    sideways = direction[:, :2] / n
    inside = np.sqrt(1.0 - (sideways**2).sum(axis=1))
    s = (outside - n * inside) / (outside + n * inside)
    p = (n * outside - inside) / (n * outside + inside)
    factor = (1.0 - 0.5 * (s**2 + p**2)) / n**2
    return Rays(entry[:, :2], np.column_stack([sideways, inside]), factor)


def henyey_greenstein(cosine: np.ndarray, g: float) -> np.ndarray:
    """Phase function, 1/sr."""
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def shortest(offset: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """Offsets (n, 2) to the nearest periodic image."""
    return offset - np.round(offset / size_mm) * size_mm


def biweight(offset: np.ndarray, radius: float) -> np.ndarray:
    """The paper's kernel at horizontal offsets (n, 2), 1/mm2, of unit integral over the plane."""
    return 3.0 / (np.pi * radius**2) * np.clip(1.0 - (offset**2).sum(axis=1) / radius**2, 0.0, None) ** 2


def gaussian(offset: np.ndarray, radius: float) -> np.ndarray:
    """Gaussian of the biweight's variance, 1/mm2."""
    return 4.0 / (np.pi * radius**2) * np.exp(-4.0 * (offset**2).sum(axis=1) / radius**2)


def beam_sum(
    photons: Photons, rays: Rays, volume: SkinVolume, depth_of: Callable, radius: float, kernel: Callable = biweight
) -> np.ndarray:
    """Beam estimate (Q,) with the kernel taken horizontally at each photon's depth.

    depth_of (ray's entry, depths): vertical optical depth of the tissue below the entry.
    """
    g, depth = volume.g[-1, 0], photons.position[:, 2]
    seen = np.empty(len(rays.entry))
    for q, (entry, direction) in enumerate(zip(rays.entry, rays.direction)):
        at = entry + depth[:, None] * (direction[:2] / direction[2])
        offset = shortest(photons.position[:, :2] - at, volume.size_mm)
        share = kernel(offset, radius) / direction[2]
        passed = np.exp(-depth_of(entry, depth) / direction[2])
        phase = henyey_greenstein(-photons.direction @ direction, g)
        seen[q] = photons.power @ (share * passed * phase)
    return seen * rays.transmission


def point_sum(
    photons: Photons, rays: Rays, volume: SkinVolume, depth_of: Callable, steps: np.ndarray, radius: np.ndarray,
    share: np.ndarray,
) -> np.ndarray:
    """Point estimate (Q,): spheres of `radius` (S,) about the middles of the march `steps` (S + 1,).

    share (n,): what each photon's weights are divided by.
    """
    g, depth = volume.g[-1, 0], photons.position[:, 2]
    middle, volume_of = 0.5 * (steps[1:] + steps[:-1]), 4.0 / 3.0 * np.pi * radius**3
    seen = np.empty(len(rays.entry))
    for q, (entry, direction) in enumerate(zip(rays.entry, rays.direction)):
        held = np.zeros(len(depth))
        for z, step, r, sphere in zip(middle, np.diff(steps), radius, volume_of):
            offset = shortest(photons.position[:, :2] - entry - z * direction[:2] / direction[2], volume.size_mm)
            inside = (offset**2).sum(axis=1) + (depth - z) ** 2 < r * r
            held += inside * (step / direction[2] / sphere)
        passed = np.exp(-depth_of(entry, depth) / direction[2])
        phase = henyey_greenstein(-photons.direction @ direction, g)
        seen[q] = photons.power @ (held / share * passed * phase)
    return seen * rays.transmission
