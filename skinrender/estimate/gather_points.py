"""Point radiance estimate (paper, section 7; Jensen and Christensen 1998): photons in spheres round sample points.

Each sample point stands in the middle of a march step of a view ray. Near the surface sample points are missing (there
is no tissue above to march through), so spheres alone lose 16 to 39 % of the light. A photon's weights over the sample
points of a ray are therefore divided by what they sum to at its depth, `depth_share`, and it is seen through the
transmittance from its own depth; laterally uniform tissue is then free of bias.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.estimate.deposit import image_range, slab_of, unpack_direction, voxel_of
from skinrender.estimate.lattice import bin_of
from skinrender.transport import kernel
from skinrender.transport.height_field import height
from skinrender.transport.phase import phase_hg


def depth_share(edges: np.ndarray, radius: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Sum over the march steps of step x sphere's cross-section / sphere's volume at some depths: 1 far from the surface.

    edges (S + 1,) of the march steps, radius (S,) of the spheres at their middles, depth (n,); all mm.
    """
    middle, step = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    section = np.pi * np.clip(radius**2 - (depth[:, None] - middle) ** 2, 0.0, None)
    return (section * (step / (4.0 / 3.0 * np.pi * radius**3))).sum(axis=1)


@kernel
def transmittance_share(fine, tau, pixel_of, pixel_depth, slab, along, x, y):
    """Transmittance at a photon's own place relative to its pixel's mean; 1 where no ray passes near.

    fine = (to_lattice, start, ray_of, h, w) of the lattice of several rays a pixel; tau (S + 1, Q) of its rays,
    pixel_depth (S + 1, pixels) of the pixels.
    """
    to_lattice, start, ray_of, h, w = fine
    cell = bin_of(to_lattice, slab, x, y, h, w)
    if cell < 0 or start[slab, cell] == start[slab, cell + 1]:
        return 1.0
    q = ray_of[slab, start[slab, cell]]
    p = pixel_of[q]
    above, below = pixel_depth[slab, p] - tau[slab, q], pixel_depth[slab + 1, p] - tau[slab + 1, q]
    return math.exp((1.0 - along) * above + along * below)


@kernel
def add_to_disc(
    s, x, y, reach, ux, uy, uz, anisotropy, weight, own, along, to_lattice, start, rays, points, region, ray_direction,
    tau, h, w, factor, image,
):
    """Adds a photon at (x, y) to the sample points of step s within `reach` sideways; returns their number."""
    contributions = 0
    a0, a1, a2 = to_lattice[s, 0, 0], to_lattice[s, 0, 1], to_lattice[s, 0, 2]
    b0, b1, b2 = to_lattice[s, 1, 0], to_lattice[s, 1, 1], to_lattice[s, 1, 2]
    row, column = a0 * x + a1 * y + a2 + 0.5, b0 * x + b1 * y + b2 + 0.5
    # the lattice's bins are not quite square where it is seen aslant: take the larger stretch
    half_rows, half_columns = reach * math.hypot(a0, a1), reach * math.hypot(b0, b1)
    low, high = max(0, int(math.floor(column - half_columns))), min(w, int(math.floor(column + half_columns)) + 1)
    if low >= high:
        return 0
    for i in range(max(0, int(math.floor(row - half_rows))), min(h, int(math.floor(row + half_rows)) + 1)):
        for k in range(start[s, i * w + low], start[s, i * w + high]):
            q = rays[s, k]
            dx, dy = points[s, q, 0] - x, points[s, q, 1] - y
            if dx * dx + dy * dy < reach * reach:
                r = region[s]
                cosine = -(ux * ray_direction[r, q, 0] + uy * ray_direction[r, q, 1] + uz * ray_direction[r, q, 2])
                passed = math.exp(-((1.0 - along) * tau[own, q] + along * tau[own + 1, q]))
                image[q] += np.float32(weight * phase_hg(cosine, anisotropy) * passed) * factor[s, q]
                contributions += 1
    return contributions


@kernel
def gather_points(
    position, direction, first, last, keep, z_top, lx, ly, periodic, relief, edges, radius, share, fine, fine_tau,
    pixel_of, region, to_lattice, bounds, start, rays, points, ray_direction, tau, h, w, palette_index, z_edges, g,
    factor, image,
):
    """Adds the photons first..last-1 of one band to all sample points whose sphere holds them.

    radius (S,): of the spheres of each step; share: `depth_share` at equidistant depths from 0 to the last edge; fine,
    fine_tau, pixel_of: of `transmittance_share`, fine None where the surface is flat; points (S, Q, 2); tau (S + 1, Q)
    of the pixels; factor (S, Q): march step / sphere volume x power, what a unit of transmitted phase function adds to
    the radiance outside. Else as `deposit.deposit`; image (Q,).
    """
    contributions = 0
    slabs = edges.size - 1
    widest = radius.max()
    deepest = edges[slabs]
    share_step = deepest / (share.size - 1)
    for i in range(first, last):
        x, y, z = np.float64(position[i, 0]), np.float64(position[i, 1]), np.float64(position[i, 2])
        if z >= deepest + (0.0 if relief is None else 1.0):
            continue
        depth = z
        if relief is not None:
            depth = max(0.0, z - height(relief, lx, ly, x, y))
        if depth >= deepest:
            continue
        weight = 1.0 / share[int(depth / share_step + 0.5)]
        if keep is not None:
            weight /= keep[1 + max(0, min(int((z - z_top) * keep[0]), keep.size - 2))]
        anisotropy = g[0]
        if palette_index is not None:
            anisotropy = g[voxel_of(palette_index, z_edges, lx, ly, x, y, z)]
        ux, uy, uz = unpack_direction(direction[i, 0], direction[i, 1])
        own = slab_of(edges, depth)
        along = (depth - edges[own]) / (edges[own + 1] - edges[own])
        if fine is not None:
            weight *= transmittance_share(fine, fine_tau, pixel_of, tau, own, along, x, y)
        s = slab_of(edges, max(0.0, depth - widest))
        while 0 <= s < slabs and edges[s] <= depth + widest:
            below = 0.5 * (edges[s] + edges[s + 1]) - depth
            rest = radius[s] * radius[s] - below * below
            if rest > 0.0:
                reach = math.sqrt(rest)
                x_first, x_last, y_first, y_last = 0, 0, 0, 0
                if periodic:
                    x_first, x_last = image_range(x, lx, bounds[s, 0] - reach, bounds[s, 2] + reach)
                    y_first, y_last = image_range(y, ly, bounds[s, 1] - reach, bounds[s, 3] + reach)
                for kx in range(x_first, x_last + 1):
                    for ky in range(y_first, y_last + 1):
                        contributions += add_to_disc(
                            s, x + kx * lx, y + ky * ly, reach, ux, uy, uz, anisotropy, weight, own, along, to_lattice,
                            start, rays, points, region, ray_direction, tau, h, w, factor, image,
                        )  # fmt: skip
            s += 1
    return contributions
