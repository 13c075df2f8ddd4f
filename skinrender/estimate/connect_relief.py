"""Reference estimate under a relief: every photon is connected to the camera by all view rays that pass through it."""

from __future__ import annotations

import math

import numpy as np

from skinrender.estimate.connect_flat import photon_weight, survives
from skinrender.estimate.deposit import image_range, unpack_direction, voxel_of
from skinrender.estimate.film_plane import pixel_of_point, pixels_per_area
from skinrender.estimate.ray_mesh import entering_ray, find_rays, reach_in_plane
from skinrender.transport import allocating_kernel, inlined_kernel, kernel
from skinrender.transport.fresnel import fresnel, refract
from skinrender.transport.height_field import first_hit
from skinrender.transport.optical_depth import add_optical_depth
from skinrender.transport.phase import phase_hg

_MOST_RAYS = 256
_ABOVE_MM = 1e-6


@kernel
def is_free(heights, cells, lx, ly, highest, entry, inside, point, length, sag):
    """Whether the surface stands neither between a photon and the entry of its ray nor between that and the camera.

    entry = (a, b, h, ray's direction outside, inward normal); inside: the ray's direction there; highest: z above which
    there is no surface; sag: that much short of the entry, along the normal, the surface itself is not an obstacle.
    """
    a, b, h, ux, uy, uz, nx, ny, nz = entry
    dx, dy, dz = inside
    x, y, z = point
    length -= sag / (dx * nx + dy * ny + dz * nz)
    if length > 0.0 and first_hit(heights, cells, lx, ly, x, y, z, -dx, -dy, -dz, length, 1.0) >= 0.0:
        return False
    return first_hit(heights, cells, lx, ly, a, b, h, -ux, -uy, -uz, (h - highest) / uz, -1.0) < 0.0


@inlined_kernel
def connect_ray(film, heights, lx, ly, eta, a, b, entry_z, spread, z, flight, anisotropy, weight):
    """What a photon at z that flies along `flight` adds by a view ray, but for what the way takes (see `deposit_relief`).

    Returns the pixel (-1: none), entry and inside as `is_free` takes them, the way's length inside, and the value.
    """
    h, ux, uy, uz, nx, ny, nz, cos_i, distance = entering_ray(film, heights, lx, ly, a, b)
    entry = (a, b, h, ux, uy, uz, nx, ny, nz)
    pixel = pixel_of_point(film, a, b, h)
    if pixel < 0 or cos_i <= 0.0:
        return -1, entry, (ux, uy, uz), 0.0, 0.0
    reflectance, cos_t = fresnel(cos_i, eta)
    dx, dy, dz = refract(ux, uy, uz, nx, ny, nz, eta, cos_i, cos_t)
    area = pixels_per_area(film, ux, uy, uz, distance) * cos_i / nz * spread / dz
    phase = phase_hg(-(flight[0] * dx + flight[1] * dy + flight[2] * dz), anisotropy)
    return pixel, entry, (dx, dy, dz), max(0.0, z - entry_z) / dz, weight * phase * (1.0 - reflectance) * eta * eta * area


@allocating_kernel
def deposit_relief(
    position, direction, first, last, keep, lx, ly, periodic, tissue, film, mesh, heights, cells, eta, least, number, image,
):
    """Adds the photons first..last-1 of one band to the picture.

    A photon of power 1 adds, for each view ray through it,

        p(w_i . -w) exp(-tau) (1 - F) eta^2 (pixels per area) cos_i / (n_z u_z) (area in (a, b) / area in the plane)

    with tau voxel by voxel along the ray from its entry to the photon.

    Parameters
    ----------
    position (N, 3), direction (N, 2) : the map's.
    keep : see `photon_weight`.
    tissue, film, mesh : the band's `Tissue` and `RayMesh`, and the `FilmPlane`.
    heights, cells, eta : the surface and n_outside / n_inside.
    least : contributions below it are left to chance, see `survives`; number : of photon `first` there.
    image : (pixels,) added to, 1/mm2/sr.

    Returns the number of contributions.
    """
    stack, found = np.empty((4 * mesh.size.shape[0] + 4, 3), np.int64), np.empty((_MOST_RAYS, 4))
    tau = np.zeros(1)
    whole, highest = mesh.bounds.shape[0] - 1, cells[:, :, 0].min() - _ABOVE_MM
    x_first, x_last, y_first, y_last, contributions = 0, 0, 0, 0, 0
    for i in range(first, last):
        z = np.float64(position[i, 2])
        if z >= tissue.deepest:
            continue
        x, y = np.float64(position[i, 0]), np.float64(position[i, 1])
        flight = unpack_direction(direction[i, 0], direction[i, 1])
        anisotropy = tissue.g[voxel_of(tissue.palette_index, tissue.z_edges, lx, ly, x, y, z)]
        weight = photon_weight(keep, tissue.z_edges[0], z)
        if periodic:
            low_x, high_x, low_y, high_y = reach_in_plane(mesh.bounds, whole, z)
            x_first, x_last = image_range(x, lx, low_x, high_x)
            y_first, y_last = image_range(y, ly, low_y, high_y)
        for kx in range(x_first, x_last + 1):
            for ky in range(y_first, y_last + 1):
                px, py = x + kx * lx, y + ky * ly
                for k in range(find_rays(mesh, px, py, z, stack, found)):
                    a, b, entry_z, spread = found[k]
                    pixel, entry, inside, length, value = connect_ray(
                        film, heights, lx, ly, eta, a, b, entry_z, spread, z, flight, anisotropy, weight
                    )
                    if pixel < 0:
                        continue
                    chance = survives(value * math.exp(-tissue.clearest * length), least, number + i - first, k)
                    if chance == 0.0 or not is_free(
                        heights, cells, lx, ly, highest, entry, inside, (px, py, z), length, mesh.sag_mm
                    ):
                        continue
                    tau[0], (dx, dy, dz) = 0.0, inside
                    add_optical_depth(
                        tissue.palette_index, tissue.z_edges, lx, ly, tissue.mu_t, a, b, entry_z, dx, dy, dz, length, tau
                    )
                    image[pixel] += np.float32(value * math.exp(-tau[0]) / chance)
                    contributions += 1
    return contributions
