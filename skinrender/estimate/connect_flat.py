"""Reference estimate under flat borders: every photon is connected to the camera by its own refracted view ray."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.estimate.deposit import image_range, unpack_direction, voxel_of
from skinrender.estimate.film_plane import pixel_of_point, pixels_per_area
from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.fresnel import fresnel
from skinrender.transport.optical_depth import add_optical_depth
from skinrender.transport.phase import phase_hg
from skinrender.transport.rng import mix64

_ITERATIONS = 60
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


class Tissue(NamedTuple):
    """One band's voxels as the connections read them.

    palette_index (nx, ny, nz), z_edges (nz + 1,): voxels without air; mu_t (P, 1), g (P,): coefficients; clearest: the
    lowest mu_t, 1/mm; deepest: z beyond which nothing is seen, mm.
    """

    palette_index: np.ndarray
    z_edges: np.ndarray
    mu_t: np.ndarray
    g: np.ndarray
    clearest: float
    deepest: float


@kernel
def photon_weight(keep, z_top, z):
    """What a photon at height z stands for; keep: bins per mm, then keep probabilities, or None when all were kept."""
    if keep is None:
        return 1.0
    return 1.0 / keep[1 + max(0, min(int((z - z_top) * keep[0]), keep.size - 2))]


@kernel
def survives(value, least, i, k):
    """Chance that connection k of photon i is followed, value / least at most 1; 0 when it is not (Russian roulette).

    The numbers are a hash of (i, k), so a picture can be repeated.
    """
    if value >= least:
        return 1.0
    word = mix64((np.uint64(i) * np.uint64(1024) + np.uint64(k) + np.uint64(1)) * _GOLDEN)
    return value / least if np.float64(word >> np.uint64(11)) * 2.0**-53 * least < value else 0.0


@kernel
def lateral_reach(p, height, z, region, borders, index):
    """Where a ray of Snell invariant p = n sin(theta) gets to.

    Parameters
    ----------
    height : of its start above the surface, mm; z : depth of its end, in `region`.
    borders : (R,) upper border of each region, mm; index : (R + 1,) of refraction, outside first.

    Returns
    -------
    outside, inside : horizontal distances per p, mm; slope : derivative of their sum times p, mm.
    """
    cosine = math.sqrt(max(index[0] * index[0] - p * p, 1e-30))
    outside, inside = height / cosine, 0.0
    slope = height * index[0] * index[0] / cosine**3
    for r in range(region + 1):
        thickness = (z if r == region else borders[r + 1]) - borders[r]
        cosine = math.sqrt(max(index[r + 1] * index[r + 1] - p * p, 1e-30))
        inside += thickness / cosine
        slope += thickness * index[r + 1] * index[r + 1] / cosine**3
    return outside, inside, slope


@kernel
def solve_snell(lateral, height, z, region, borders, index):
    """Snell invariant of the ray from `height` above the surface that gets to depth z at a horizontal distance
    (Newton)."""
    low, high = 0.0, index[0]
    for r in range(1, region + 2):
        high = min(high, index[r])
    p = min(index[0] * lateral / math.sqrt(lateral * lateral + (height + z) ** 2), high * (1.0 - 1e-9))
    for _ in range(_ITERATIONS):
        outside, inside, slope = lateral_reach(p, height, z, region, borders, index)
        excess = p * (outside + inside) - lateral
        if abs(excess) <= 1e-12 * (height + z):
            break
        if excess > 0.0:
            high = p
        else:
            low = p
        p -= excess / slope
        if not low < p < high:
            p = 0.5 * (low + high)
    return p


@kernel
def connect_flat(film, x, y, z, region, borders, index):
    """The refracted view ray that gets to (x, y, z).

    Returns
    -------
    entry_x, entry_y : where it enters; ex, ey : its horizontal unit direction; p : its Snell invariant.
    area : pixels per horizontal mm2 at the depth of the point.
    """
    if not film.is_pinhole:
        sine = math.sqrt(film.axis[0] * film.axis[0] + film.axis[1] * film.axis[1])
        ex, ey = (film.axis[0] / sine, film.axis[1] / sine) if sine > 0.0 else (1.0, 0.0)
        p = index[0] * sine
        _, inside, _ = lateral_reach(p, 0.0, z, region, borders, index)
        area = pixels_per_area(film, film.axis[0], film.axis[1], film.axis[2], 1.0) * film.axis[2]
        return x - ex * p * inside, y - ey * p * inside, ex, ey, p, area
    dx, dy, height = x - film.x, y - film.y, -film.z
    lateral = math.sqrt(dx * dx + dy * dy)
    ex, ey = (dx / lateral, dy / lateral) if lateral > 0.0 else (1.0, 0.0)
    p = solve_snell(lateral, height, z, region, borders, index)
    outside, inside, slope = lateral_reach(p, height, z, region, borders, index)
    sine = p / index[0]
    cosine = math.sqrt(1.0 - sine * sine)
    solid_angle = 1.0 / (index[0] * index[0] * cosine * (outside + inside) * slope)
    area = pixels_per_area(film, ex * sine, ey * sine, cosine, 1.0) * solid_angle
    return x - ex * p * inside, y - ey * p * inside, ex, ey, p, area


@kernel
def transmission_to(p, region, index):
    """Factor from radiance in a region to radiance outside, and the ray's cosine in the region."""
    factor, cosine = 1.0, math.sqrt(max(0.0, 1.0 - (p / index[0]) ** 2))
    for r in range(region + 1):
        reflectance, cosine = fresnel(cosine, index[r] / index[r + 1])
        factor *= 1.0 - reflectance
    return factor * (index[0] / index[region + 1]) ** 2, cosine


@kernel
def add_depth_along(tissue, lx, ly, x, y, z, region, ex, ey, p, borders, index, tau):
    """Adds to tau (1,) the optical depth of the ray that enters at (x, y) down to depth z in `region`."""
    for r in range(region + 1):
        top, bottom = borders[r], z if r == region else borders[r + 1]
        sine = p / index[r + 1]
        cosine = math.sqrt(max(1e-30, 1.0 - sine * sine))
        length = (bottom - top) / cosine
        add_optical_depth(
            tissue.palette_index, tissue.z_edges, lx, ly, tissue.mu_t, x, y, top, ex * sine, ey * sine, cosine, length,
            tau
        )
        x, y = x + ex * sine * length, y + ey * sine * length


@allocating_kernel
def deposit_flat(
    position, direction, first, last, keep, lx, ly, periodic, tissue, film, box, drift, borders, index, least, number,
    image,
):
    """Adds the photons first..last-1 of one band to the picture.

    A photon of power 1 adds p(w_i . -w) exp(-tau) prod(1 - F) (n_outside / n)^2 (pixels per area at its depth) / w_z.

    Parameters
    ----------
    box : (4,) lowest x and y, highest x and y of entries that can be seen; drift : (4,) lowest and highest move aside
        of a ray per depth, in the same order.
    borders, index : see `lateral_reach`; the rest as `connect_relief.deposit_relief`.

    Returns the number of contributions.
    """
    tau = np.zeros(1)
    x_first, x_last, y_first, y_last = 0, 0, 0, 0
    contributions = 0
    for i in range(first, last):
        z = np.float64(position[i, 2])
        if z >= tissue.deepest:
            continue
        z = max(z, 0.0)
        x, y = np.float64(position[i, 0]), np.float64(position[i, 1])
        vx, vy, vz = unpack_direction(direction[i, 0], direction[i, 1])
        anisotropy = tissue.g[voxel_of(tissue.palette_index, tissue.z_edges, lx, ly, x, y, z)]
        weight = photon_weight(keep, tissue.z_edges[0], z)
        region = max(0, np.searchsorted(borders, z, side="right") - 1)
        if periodic:
            x_first, x_last = image_range(x, lx, box[0] + z * drift[0], box[2] + z * drift[2])
            y_first, y_last = image_range(y, ly, box[1] + z * drift[1], box[3] + z * drift[3])
        for kx in range(x_first, x_last + 1):
            for ky in range(y_first, y_last + 1):
                entry_x, entry_y, ex, ey, p, area = connect_flat(
                    film, x + kx * lx, y + ky * ly, z, region, borders, index
                )
                pixel = pixel_of_point(film, entry_x, entry_y, 0.0)
                if pixel < 0 or not (periodic or (0.0 <= entry_x <= lx and 0.0 <= entry_y <= ly)):
                    continue
                passed, dz = transmission_to(p, region, index)
                sine = math.sqrt(max(0.0, 1.0 - dz * dz))
                phase = phase_hg(-(vx * ex * sine + vy * ey * sine + vz * dz), anisotropy)
                value = weight * phase * passed * area / dz
                image_number = 8 * (kx - x_first) + ky - y_first
                chance = survives(value * math.exp(-tissue.clearest * z), least, number + i - first, image_number)
                if chance > 0.0:
                    tau[0] = 0.0
                    add_depth_along(tissue, lx, ly, entry_x, entry_y, z, region, ex, ey, p, borders, index, tau)
                    image[pixel] += np.float32(value * math.exp(-tau[0]) / chance)
                    contributions += 1
    return contributions
