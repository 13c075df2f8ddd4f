"""Transmittance along the view rays (paper, section 7.2): optical depth voxel by voxel, from the entry point
inwards."""

from __future__ import annotations

import numpy as np

from skinrender.estimate.ray_paths import RayPaths
from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.optical_depth import add_optical_depth

TILE = 16
"""Rays whose optical depths are written together: one cache line of each band and slab edge."""


@allocating_kernel
def view_optical_depth(
    palette_index, z_edges, lx, ly, mu_t, entry, direction, region, path_edges, hit, deepest, first, last, depth
):
    """Optical depth from the entry to each slab edge for the rays first..last-1, into depth (B, S + 1, Q).

    mu_t (P, B), 1/mm: the bands wanted. Where no band's depth is less than `deepest` a ray is not followed voxel by
    voxel: its depth grows by `deepest` a slab.
    """
    slabs, bands = path_edges.shape[0] - 1, mu_t.shape[1]
    tau = np.zeros((TILE, slabs, bands))
    for start in range(first, last, TILE):
        stop = min(start + TILE, last)
        for q in range(start, stop):
            if hit[q]:
                _follow(
                    palette_index, z_edges, lx, ly, mu_t, entry, direction, region, path_edges, deepest, q,
                    tau[q - start]
                )
            else:
                tau[q - start] = 0.0
        for b in range(bands):
            for s in range(slabs):
                for q in range(start, stop):
                    depth[b, s + 1, q] = tau[q - start, s, b]


@kernel
def _follow(palette_index, z_edges, lx, ly, mu_t, entry, direction, region, path_edges, deepest, q, tau):
    """Optical depth of ray q at the lower edge of each slab, into tau (S, B)."""
    slabs, bands = tau.shape
    x, y, z = entry[q, 0], entry[q, 1], entry[q, 2]
    for s in range(slabs):
        clearest = np.inf
        for b in range(bands):
            tau[s, b] = tau[s - 1, b] if s else 0.0
            clearest = min(clearest, tau[s, b])
        ux, uy, uz = direction[region[s], q, 0], direction[region[s], q, 1], direction[region[s], q, 2]
        length = path_edges[s + 1, q] - path_edges[s, q]
        if clearest < deepest:
            add_optical_depth(palette_index, z_edges, lx, ly, mu_t, x, y, z, ux, uy, uz, length, tau[s])
        else:
            for b in range(bands):
                tau[s, b] += deepest
        x, y, z = x + length * ux, y + length * uy, z + length * uz


def allocate(rays: RayPaths, bands: int) -> np.ndarray:
    """Room for the optical depths of some bands, (bands, S + 1, Q) f4."""
    return np.zeros((bands, rays.slabs + 1, len(rays.hit)), dtype=np.float32)
