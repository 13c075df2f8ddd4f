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

from skinrender.estimate.lattice import SEVERAL_RAYS, bin_of
from skinrender.transport import allocating_kernel, entry_kernel, inlined_kernel, kernel
from skinrender.transport.height_field import height
from skinrender.transport.optical_depth import edges_above
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
    k = min(max(edges_above(z_edges, z) - 1, 0), nz - 1)
    return palette_index[i, j, k]


@kernel
def slab_of(edges, depth):
    """Depth slab of a photon, or -1 when it is too deep to be seen."""
    if depth >= edges[edges.size - 1]:
        return -1
    slab = 0
    for k in range(1, edges.size - 1):
        slab += depth >= edges[k]  # no branch to mispredict
    return slab


@kernel
def image_range(x, length, low, high):
    """Periods k, first and last, for which x + k length lies in [low, high]."""
    if low <= x <= high and x - length < low and x + length > high:
        return 0, 0
    return math.ceil((low - x) / length), math.floor((high - x) / length)


DROP, WEIGHT = 0, 1
MOST_RISE = 40.0
"""Optical depth from mid-slab up to a photon; where it is more, the slab does not show and the number need only be
finite."""
BLOCK = 256


@entry_kernel
def ray_weights(slab, tau, transmittance, outside_power, descent, bin_area, pixel_of, worth, factor):
    """What a photon's connection to a ray is worth in one slab, in two factors.

    The filter must blur the light alone and nothing that belongs to the ray: neither its transmittance nor, on a
    relief, its refraction and tilt, which go together with the transmittance. So what a pixel's rays are worth on
    average at mid-slab is applied after the filter, and before it only what one ray is worth relative to that.

    Parameters
    ----------
    tau : (S + 1, Q) f4, optical depth of the rays at the slab edges.
    transmittance : (Q,) f4, exp of minus the optical depth at mid-slab; numpy's is four times as fast as one here.
    outside_power : (Q,) f4, power of a photon times the factor from radiance inside to radiance outside.
    descent (S, Q) f4, bin_area (S,) : of the rays and their bins.
    pixel_of : (Q,) pixel of each ray.
    worth : (S, Q, 2) f4, row `slab` filled; before the filter: DROP, the optical depth across the slab along the ray,
        and WEIGHT, the ray's worth relative to its pixel's / bin area. Side by side, as each costs a cache miss.
    factor : (S, pixels) f4, added to; after it: transmittance to mid-slab x outside power / descent, mean over the
        pixel's rays.
    """
    count, pixels = tau.shape[1], factor.shape[1]
    share = np.float32(pixels / count)
    for q in range(count):
        own = transmittance[q] * outside_power[q] / descent[slab, q]
        worth[slab, q, DROP], worth[slab, q, WEIGHT] = tau[slab + 1, q] - tau[slab, q], own
        factor[slab, pixel_of[q]] += own * share
    share = np.float32(share / bin_area[slab])
    for q in range(count):
        mean = factor[slab, pixel_of[q]]
        worth[slab, q, WEIGHT] = worth[slab, q, WEIGHT] / mean * share if mean > 0.0 else np.float32(0.0)


@kernel
def connect(slab, q, ux, uy, uz, anisotropy, half, region, ray_direction, worth):
    """Light that a photon sends along ray q, in units of the pixel's factor of `ray_weights`."""
    r = region[slab]
    cosine = -(ux * ray_direction[r, q, 0] + uy * ray_direction[r, q, 1] + uz * ray_direction[r, q, 2])
    rise = min(half * worth[slab, q, DROP], MOST_RISE)
    return phase_hg(cosine, anisotropy) * math.exp(rise) * worth[slab, q, WEIGHT]


@kernel
def find_cells(
    position, direction, i, last, keep, z_top, lx, ly, periodic, relief, edges, to_lattice, bounds, h, w, palette_index,
    z_edges, g, entry, cell_of,
):
    """First pass over photons i..last-1: fills a block with those that are seen; returns (next photon, entries).

    entry (BLOCK + images, 6): direction, anisotropy, weight, half slab minus place in it; cell_of (BLOCK + images, 2):
    slab and bin; images is the most that one photon can have.
    """
    deepest = edges[edges.size - 1]
    reach = deepest + (0.0 if relief is None else 1.0)
    n = 0
    while i < last and n < BLOCK:
        z = np.float64(position[i, 2])
        if z >= reach:
            i += 1
            continue
        x, y = np.float64(position[i, 0]), np.float64(position[i, 1])
        depth = z if relief is None else z - height(relief, lx, ly, x, y)
        depth = max(0.0, depth)
        slab = slab_of(edges, depth)
        if slab < 0:
            i += 1
            continue
        x_first, x_last, y_first, y_last = 0, 0, 0, 0
        if periodic:
            x_first, x_last = image_range(x, lx, bounds[slab, 0], bounds[slab, 2])
            y_first, y_last = image_range(y, ly, bounds[slab, 1], bounds[slab, 3])
        for kx in range(x_first, x_last + 1):
            for ky in range(y_first, y_last + 1):
                cell = bin_of(to_lattice, slab, x + kx * lx, y + ky * ly, h, w)
                if cell < 0:
                    continue
                cell_of[n, 0], cell_of[n, 1] = slab, cell
                entry[n, 0], entry[n, 1], entry[n, 2] = unpack_direction(direction[i, 0], direction[i, 1])
                entry[n, 3] = g[0]
                if palette_index is not None:
                    entry[n, 3] = g[voxel_of(palette_index, z_edges, lx, ly, x, y, z)]
                entry[n, 4] = 1.0
                if keep is not None:
                    entry[n, 4] = 1.0 / keep[1 + max(0, min(int((z - z_top) * keep[0]), keep.size - 2))]
                entry[n, 5] = 0.5 - (depth - edges[slab]) / (edges[slab + 1] - edges[slab])
                n += 1
        i += 1
    return i, n


@kernel
def add_light(image, y_image, factor, y_weight, slab, pixel, value):
    """Enters a contribution; returns it with the pixel's factor."""
    image[slab, pixel] += value
    shown = value * factor[slab, pixel]
    y_image[pixel] += shown * y_weight
    return shown


@inlined_kernel
def add_to_each(
    light, k, slab, cell, entry, start, rays, region, ray_direction, worth, pixel_of, factor, y_weight, image, y_image
):
    """Enters a block's photon k into the pixels of all rays of its bin; returns the light so far with theirs."""
    for j in range(start[slab, cell], start[slab, cell + 1]):
        q = np.int64(rays[slab, j])
        value = connect(
            slab, q, entry[k, 0], entry[k, 1], entry[k, 2], entry[k, 3], entry[k, 5], region, ray_direction, worth
        )
        light += add_light(image, y_image, factor, y_weight, slab, np.int64(pixel_of[q]), entry[k, 4] * value)
    return light


@allocating_kernel
def deposit(
    position, direction, first, last, keep, z_top, lx, ly, periodic, relief, edges, region, to_lattice, bounds,
    only_ray, start, rays, ray_direction, worth, pixel_of, h, w, palette_index, z_edges, g, factor, y_weight, image, y_image,
):
    """Adds the photons first..last-1 of one band to the slab images, and what they show to their batch's luminance.

    In passes over blocks of photons: which bin, which ray, what it is worth. Every table is larger than the cache, and
    only when a pass does nothing but look up do the processor's misses overlap.

    Parameters
    ----------
    position (N, 3), direction (N, 2) : the map's.
    keep : (1 + D,) bins per mm and keep probabilities of the band, or None: all weights are 1.
    relief : (hx, hy) float32 control points or None.
    edges, region, to_lattice, bounds, only_ray, start, rays, ray_direction : of the `RayLattice` and its rays.
    worth : of `ray_weights`; pixel_of (Q,): pixel of each ray.
    palette_index, z_edges : the voxels, or None when g is the same everywhere.
    g : (P,) anisotropy in the band.
    factor : (S, pixels) of `ray_weights`; y_weight: luminance of the band.
    image : (S, pixels) f8, added to: radiance outside but for the factor.
    y_image : (pixels,) f8, added to: luminance, not filtered. A batch holds fewer photons than slab images have pixels,
        so that images of its own, cleared and summed for every band, took longer than the photons.

    Returns the number of contributions and their sum, with the factor.
    """
    room = BLOCK + 1
    if periodic:
        for s in range(bounds.shape[0]):
            tiles_x, tiles_y = (bounds[s, 2] - bounds[s, 0]) / lx, (bounds[s, 3] - bounds[s, 1]) / ly
            room = max(room, BLOCK + (int(tiles_x) + 2) * (int(tiles_y) + 2))
    entry, cell_of, ray = np.empty((room, 6)), np.empty((room, 2), np.int64), np.empty(room, np.int64)
    contributions, light = 0, 0.0
    i = first
    while i < last:
        i, n = find_cells(
            position, direction, i, last, keep, z_top, lx, ly, periodic, relief, edges, to_lattice, bounds, h, w,
            palette_index, z_edges, g, entry, cell_of,
        )  # fmt: skip
        for k in range(n):
            ray[k] = only_ray[cell_of[k, 0], cell_of[k, 1]]
        for k in range(n):
            slab, q = cell_of[k, 0], ray[k]
            if q >= 0:
                value = connect(
                    slab, q, entry[k, 0], entry[k, 1], entry[k, 2], entry[k, 3], entry[k, 5], region, ray_direction, worth
                )
                entry[k, 0] = entry[k, 4] * value
                ray[k] = pixel_of[q]
            elif q == SEVERAL_RAYS:
                cell = cell_of[k, 1]
                contributions += start[slab, cell + 1] - start[slab, cell]
                light = add_to_each(
                    light, k, slab, cell, entry, start, rays, region, ray_direction, worth, pixel_of, factor, y_weight,
                    image, y_image,
                )  # fmt: skip
        for k in range(n):
            if ray[k] >= 0:
                light += add_light(image, y_image, factor, y_weight, cell_of[k, 0], ray[k], entry[k, 0])
                contributions += 1
    return contributions, light
