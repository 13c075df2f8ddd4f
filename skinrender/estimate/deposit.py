"""Beam radiance estimate, first half: every photon is connected once to the view ray that passes its bin.

The paper's equation (3) sums, over the photons near a beam, kernel x transmittance x phase function x power. The
kernel is taken horizontally at equal depth, so it is a filter on the image of one depth slab and can be applied
afterwards; what a photon adds before filtering is 1 / bin area (the narrowest kernel there is).

The printed equation also multiplies by mu_s. The photons are *stored at scattering events*, so their density is already
mu_s times the fluence; with another mu_s the result would have the dimension of radiance per length. It is left out.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.estimate.lattice import bin_of
from skinrender.transport import kernel
from skinrender.transport.height_field import height
from skinrender.transport.phase import phase_hg


@kernel
def unpack_direction(code_x, code_y):
    """Unit vector of an octahedral code (see `turn.pack_direction`): the middle of its cell."""
    px = (np.float64(code_x) + 0.5 - 32768.0) / 32767.0
    py = (np.float64(code_y) + 0.5 - 32768.0) / 32767.0
    pz = 1.0 - abs(px) - abs(py)
    if pz < 0.0:
        px, py = (1.0 - abs(py)) * math.copysign(1.0, px), (1.0 - abs(px)) * math.copysign(1.0, py)
    inverse = 1.0 / math.sqrt(px * px + py * py + pz * pz)
    return px * inverse, py * inverse, pz * inverse


@kernel
def voxel_of(palette_index, z_edges, lx, ly, x, y, z):
    """Palette entry of the voxel that holds (x, y, z)."""
    nx, ny, nz = palette_index.shape
    i = min(max(int(x * (nx / lx)), 0), nx - 1)
    j = min(max(int(y * (ny / ly)), 0), ny - 1)
    k = min(max(np.searchsorted(z_edges, z, side="right") - 1, 0), nz - 1)
    return palette_index[i, j, k]


@kernel
def slab_of(edges, depth):
    """Depth slab of a photon, or -1 when it is too deep to be seen."""
    if depth >= edges[edges.size - 1]:
        return -1
    low, high = 0, edges.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if depth >= edges[middle]:
            low = middle
        else:
            high = middle
    return low


@kernel
def image_range(x, length, low, high):
    """Periods k, first and last, for which x + k length lies in [low, high]."""
    if low <= x <= high and x - length < low and x + length > high:
        return 0, 0
    return math.ceil((low - x) / length), math.floor((high - x) / length)


@kernel
def ray_weights(tau, pixel_depth, outside_power, region, descent, bin_area, pixel_of):
    """What a photon's connection to a ray is worth, in two factors.

    The filter must not blur the transmittance, so the pixel's own, to mid-slab, is kept apart from what it filters.

    Parameters
    ----------
    tau : (S + 1, Q) optical depth of the rays at the slab edges; pixel_depth (S + 1, pixels): of the pixels.
    outside_power : (R, Q) power of a photon times the factor from radiance inside to radiance outside.
    region (S,), descent (S, Q), bin_area (S,) : of the rays and their bins; pixel_of (Q,) : pixel of each ray.

    Returns
    -------
    drop : (S, Q) f4 optical depth across the slab along the ray.
    ray_weight : (S, Q) f4, before the filter: the ray's transmittance relative to its pixel's, power and bin area.
    factor : (S, pixels) f4, after it: the pixel's transmittance to mid-slab.
    """
    slabs, count, pixels = tau.shape[0] - 1, tau.shape[1], pixel_depth.shape[1]
    drop, ray_weight = np.empty((slabs, count), np.float32), np.empty((slabs, count), np.float32)
    factor = np.empty((slabs, pixels), np.float32)
    half = np.float32(0.5)
    for s in range(slabs):
        for p in range(pixels):
            factor[s, p] = np.exp(-half * (pixel_depth[s, p] + pixel_depth[s + 1, p]))
        share = pixels / (count * bin_area[s])
        for q in range(count):
            p = pixel_of[q]
            drop[s, q] = tau[s + 1, q] - tau[s, q]
            middle = half * (pixel_depth[s, p] + pixel_depth[s + 1, p] - tau[s, q] - tau[s + 1, q])
            ray_weight[s, q] = np.exp(middle) * outside_power[region[s], q] * share / descent[s, q]
    return drop, ray_weight, factor


@kernel
def deposit(
    position, direction, first, last, keep, z_top, lx, ly, periodic, relief, edges, region, to_lattice, bounds, start,
    rays, ray_direction, drop, ray_weight, pixel_of, h, w, palette_index, z_edges, g, factor, y_weight, image, y_image,
):
    """Adds the photons first..last-1 of one band to the slab images.

    Parameters
    ----------
    position (N, 3), direction (N, 2) : the map's.
    keep : (1 + D,) bins per mm and keep probabilities of the band, or None: all weights are 1.
    relief : (hx, hy) float64 control points or None.
    edges, region, to_lattice, bounds, start, rays, ray_direction : of the `RayLattice` and its rays.
    drop, ray_weight, factor : of `ray_weights`; pixel_of (Q,): pixel of each ray.
    palette_index, z_edges : the voxels, or None when g is the same everywhere.
    g : (P,) anisotropy in the band.
    y_weight : luminance of one W mm^-2 sr^-1.
    image : (S, pixels) f4, added to: radiance outside but for `factor`.
    y_image : (S, pixels) f4, the same times `factor` and `y_weight`: the batch's luminance, for the standard error.

    Returns
    -------
    (contributions, radiance added, summed over the pixels).
    """
    contributions, total = 0, 0.0
    deepest = edges[edges.size - 1]
    for i in range(first, last):
        x, y, z = np.float64(position[i, 0]), np.float64(position[i, 1]), np.float64(position[i, 2])
        if relief is None:
            depth = z
            if depth >= deepest:
                continue
        else:
            if z >= deepest + 1.0:
                continue
            depth = max(0.0, z - height(relief, lx, ly, x, y))
        slab = slab_of(edges, max(0.0, depth))
        if slab < 0:
            continue
        weight = 1.0
        if keep is not None:
            weight = 1.0 / keep[1 + max(0, min(int((z - z_top) * keep[0]), keep.size - 2))]
        anisotropy = g[0]
        if palette_index is not None:
            anisotropy = g[voxel_of(palette_index, z_edges, lx, ly, x, y, z)]
        ux, uy, uz = unpack_direction(direction[i, 0], direction[i, 1])
        along = (depth - edges[slab]) / (edges[slab + 1] - edges[slab])
        x_first, x_last, y_first, y_last = 0, 0, 0, 0
        if periodic:
            x_first, x_last = image_range(x, lx, bounds[slab, 0], bounds[slab, 2])
            y_first, y_last = image_range(y, ly, bounds[slab, 1], bounds[slab, 3])
        for kx in range(x_first, x_last + 1):
            for ky in range(y_first, y_last + 1):
                cell = bin_of(to_lattice[slab], x + kx * lx, y + ky * ly, h, w)
                if cell < 0:
                    continue
                for k in range(start[slab, cell], start[slab, cell + 1]):
                    q = rays[slab, k]
                    wx, wy, wz = ray_direction[region[slab], q]
                    phase = phase_hg(-(ux * wx + uy * wy + uz * wz), anisotropy)
                    passed = math.exp((0.5 - along) * drop[slab, q])
                    value = np.float32(weight * phase * passed) * ray_weight[slab, q]
                    pixel = pixel_of[q]
                    image[slab, pixel] += value
                    shown = value * factor[slab, pixel]
                    y_image[slab, pixel] += shown * y_weight
                    total += shown
                    contributions += 1
    return contributions, total
