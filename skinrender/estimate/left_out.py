"""How much light may be missing because view rays are followed along one way only: into the skin, to their first border.

Of what a pixel sees, a ray's share exp(-tau) still lies ahead where the ray is given up: at a side, at a furrow's wall;
where a border reflects a part of it, that part. A ray that the surface reflects onto another of its slopes would see the
light that comes out there. Each share is multiplied by light about as bright as what the ray has met, so the sum of them
estimates the missing share of the radiance.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.estimate.ray_paths import follow_rays
from skinrender.estimate.view_path import make_view_path, relief_arrays
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume
from skinrender.transport import allocating_kernel
from skinrender.transport.fresnel import fresnel, reflect
from skinrender.transport.height_field import first_hit
from skinrender.transport.optical_depth import add_optical_depth

_DARK = 12.0
_ABOVE_MM = 1e-6


def share_left_out(origin: np.ndarray, direction: np.ndarray, volume: SkinVolume) -> np.ndarray:
    """Share of the light from inside that may be missing in each band, (B,), over view rays (..., 3)."""
    regions = regions_of(volume)
    view = make_view_path(origin, direction, volume)
    if not view.hit.any():
        return np.zeros(len(volume.wavelength_nm))
    borders = np.clip(regions.border_z_mm, 0.0, None)
    paths = follow_rays(origin, direction, volume, borders)
    relief = None if volume.surface_mm is None else relief_arrays(volume.surface_mm)
    mu_t = np.ascontiguousarray(volume.mu_a + volume.mu_s)
    ahead = _ahead(
        view.entry, np.ascontiguousarray(paths.direction, np.float64), view.hit, borders, regions.index, relief, volume.tissue_index,
        np.ascontiguousarray(volume.z_edges_mm, np.float64), *map(float, volume.size_mm), volume.sides == "periodic", mu_t,
    )  # fmt: skip
    share = (view.transmission * ahead).sum(axis=0) / view.transmission.sum(axis=0)
    if relief is not None:
        meets = _meets_again(view.entry, view.view_direction, view.normal, view.hit, *relief, *map(float, volume.size_mm))
        share = share + (1.0 - view.transmission * (regions.index[1] / regions.index[0]) ** 2)[meets].sum(axis=0) / view.hit.sum()
    return share


@allocating_kernel
def _ahead(entry, direction, hit, borders, index, relief, palette, z_edges, lx, ly, periodic, mu_t):
    """Transmittance to where each ray is given up times what is reflected there, (Q, B)."""
    bands = mu_t.shape[1]
    share, tau = np.zeros((entry.shape[0], bands)), np.zeros(bands)
    for q in range(entry.shape[0]):
        if not hit[q]:
            continue
        x, y, z = entry[q]
        tau[:] = 0.0
        for r in range(borders.size - 1):
            dx, dy, dz = direction[r, q]
            length = (borders[r + 1] - z) / dz
            end, ends = length, False
            if not periodic:
                end = min(end, ((lx if dx > 0.0 else 0.0) - x) / dx if dx != 0.0 else np.inf)
                end = min(end, ((ly if dy > 0.0 else 0.0) - y) / dy if dy != 0.0 else np.inf)
                ends = end < length
            end = min(end, _DARK / max(1e-9, mu_t[1:].min()))
            if relief is not None:
                wall = first_hit(relief[0], relief[1], lx, ly, x, y, z, dx, dy, dz, end, 1.0)
                end, ends = (wall, True) if wall >= 0.0 else (end, ends)
            add_optical_depth(palette, z_edges, lx, ly, mu_t, x, y, z, dx, dy, dz, max(0.0, end), tau)
            for b in range(bands):
                reflected = 1.0 if ends else fresnel(dz, index[r + 1, b] / index[r + 2, b])[0]
                share[q, b] += reflected * math.exp(-tau[b])
            if ends or tau.min() > _DARK:
                break
            x, y, z = x + end * dx, y + end * dy, z + end * dz
    return share


@allocating_kernel
def _meets_again(entry, view_direction, normal, hit, heights, cells, lx, ly):
    """Whether the surface reflects each ray onto itself, (Q,) bool."""
    highest = cells[:, :, 0].min() - _ABOVE_MM
    meets = np.zeros(hit.size, np.bool_)
    for q in range(hit.size):
        if not hit[q]:
            continue
        x, y, z = entry[q]
        ux, uy, uz = view_direction[q]
        cosine = ux * normal[q, 0] + uy * normal[q, 1] + uz * normal[q, 2]
        dx, dy, dz = reflect(ux, uy, uz, normal[q, 0], normal[q, 1], normal[q, 2])
        limit = (z - highest) / -dz if dz < -1e-3 else 1e3 * (z - highest) + lx + ly
        meets[q] = cosine < 0.0 and first_hit(heights, cells, lx, ly, x, y, z, dx, dy, dz, limit, -1.0) >= 0.0
    return meets
