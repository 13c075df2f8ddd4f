"""Transmittance along the view rays (paper, section 7.2): optical depth voxel by voxel, from the entry point inwards."""

from __future__ import annotations

import numpy as np

from skinrender.estimate.ray_paths import RayPaths
from skinrender.transport import allocating_kernel
from skinrender.transport.optical_depth import add_optical_depth


@allocating_kernel
def view_optical_depth(
    palette_index, z_edges, lx, ly, mu_t, entry, direction, region, path_edges, hit, deepest, first, last, depth
):
    """Optical depth from the entry to each slab edge for the rays first..last-1, into depth (B, S + 1, Q).

    mu_t (P, B): the bands wanted. Beyond `deepest` a ray is not followed voxel by voxel; its depth grows as before.
    """
    slabs = path_edges.shape[0] - 1
    tau = np.zeros(mu_t.shape[1])
    for q in range(first, last):
        if not hit[q]:
            continue
        x, y, z = entry[q]
        tau[:] = 0.0
        for s in range(slabs):
            ux, uy, uz = direction[region[s], q]
            length = path_edges[s + 1, q] - path_edges[s, q]
            if tau.min() < deepest:
                add_optical_depth(palette_index, z_edges, lx, ly, mu_t, x, y, z, ux, uy, uz, length, tau)
            else:
                tau += deepest
            x, y, z = x + length * ux, y + length * uy, z + length * uz
            for b in range(tau.size):
                depth[b, s + 1, q] = tau[b]


def allocate(rays: RayPaths, bands: int) -> np.ndarray:
    """Room for the optical depths of some bands, (bands, S + 1, Q) f4."""
    return np.zeros((bands, rays.slabs + 1, len(rays.hit)), dtype=np.float32)
