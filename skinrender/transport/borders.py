"""Borders between media of different index: the surface, inner borders, the bottom and the sides.

A border is hit exactly on its plane or height field, with that surface's own normal, never on a voxel's face; the
free path has no memory, so a flight simply ends on the border and the next one starts there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.transport import inlined_kernel, kernel
from skinrender.transport.fresnel import fresnel, reflect, refract
from skinrender.transport.height_field import first_hit, height
from skinrender.transport.lanes import (
    BAND,
    BORDER,
    FRESH,
    LANES,
    PATH,
    REGION,
    STRAIGHT,
    UX,
    UY,
    UZ,
    Z_SAFE_BOTTOM,
    Z_SAFE_TOP,
    Z_START,
    M,
    X,
    Y,
    Z,
)
from skinrender.transport.relief import OFFSET_MM, ROUGH, rough_normal
from skinrender.transport.rng import draw

PERIODIC, OPEN, DIELECTRIC = 0, 1, 2
INSIDE, LEFT_TOP, LEFT_BOTTOM, LEFT_SIDE = 0, 1, 2, 3
_MAX_AIR_BOUNCES = 10_000


# Columns of `Borders.table`: z of the border, its row in the height fields or -1, and of the region below it the depths
# between which none of its borders reaches.
BORDER_Z, SAFE_TOP, SAFE_BOTTOM = 0, 2, 3


class Borders(NamedTuple):
    """Borders of R regions, top to bottom; z in mm from the top of the volume.

    table (R + 1, 4): see the columns; index (B, R + 2): refractive indices of each band outside, in the regions and
    below; lx, ly: extent of the patch. Few members: a kernel call copies each array's header, and with fourteen arrays
    that cost more than the border itself.
    """

    table: np.ndarray
    index: np.ndarray
    lx: float
    ly: float
    sides: int


@kernel
def index_of(borders, band, region):
    """Refractive index of a region in a band; -1 is the outside, R what lies below."""
    return borders.index[np.uint64(band), np.uint64(region + 1)]


@kernel
def majorant_depth(majorant, band, z):
    """Majorant optical depth of a band at depth z (mm); majorant (B, slabs, 3): upper edge (mm), its optical depth,
    majorant (1/mm)."""
    k = majorant.shape[1] - 1
    while k > 0 and z < majorant[band, k, 0]:
        k -= 1
    return majorant[band, k, 1] + (z - majorant[band, k, 0]) * majorant[band, k, 2]


@kernel
def split(words, lane, cos_i, index_from, index_to):
    """Fresnel at a smooth border, drawn, not weighted: (is reflected, cosine of the refracted ray)."""
    if index_from == index_to:
        return False, cos_i
    reflectance, cos_t = fresnel(cos_i, index_from / index_to)
    if reflectance >= 1.0:
        return True, 0.0
    return draw(words, lane, LANES) < reflectance, cos_t


@inlined_kernel
def border_distance(borders, relief, k, side, x, y, z, dx, dy, dz, path):
    """Path length at which the flight (x, y, z) + s (dx, dy, dz), s in (0, path], meets border k, or -1.

    side = +1: the flight starts below the border, -1: above it.
    """
    if relief is not None:
        row = int(borders.table[k, ROUGH])
        if row >= 0:
            return first_hit(
                relief.heights[row], relief.bounds[row], borders.lx, borders.ly, x, y, z, dx, dy, dz, path,
                np.float64(side)
            )
    end = z + dz * path
    if side > 0:
        if end >= borders.table[k, BORDER_Z]:
            return -1.0
    elif end <= borders.table[k, BORDER_Z]:
        return -1.0
    return max(0.0, min(path, (borders.table[k, BORDER_Z] - z) / dz))


@kernel
def side_distance(borders, x, y, dx, dy, path):
    """Path length at which the flight leaves the patch sideways (or path + 1), and the wall's normal (inwards)."""
    best, nx, ny = path + 1.0, 0.0, 0.0
    if dx < 0.0 and x + dx * path < 0.0:
        best, nx, ny = max(0.0, -x / dx), 1.0, 0.0
    elif dx > 0.0 and x + dx * path > borders.lx:
        best, nx, ny = max(0.0, (borders.lx - x) / dx), -1.0, 0.0
    s = path + 1.0
    if dy < 0.0 and y + dy * path < 0.0:
        s = max(0.0, -y / dy)
    elif dy > 0.0 and y + dy * path > borders.ly:
        s = max(0.0, (borders.ly - y) / dy)
    if s < best:
        best, nx, ny = s, 0.0, -1.0 if dy > 0.0 else 1.0
    return best, nx, ny


@inlined_kernel
def enter_surface(w, i, borders, relief, x, y, z, ux, uy, uz):
    """Follows the photon of lane i in the air above a height field until it enters the skin or escapes upwards.

    Returns (entered, x, y, z, ux, uy, uz).
    """
    lx, ly = borders.lx, borders.ly
    band = w[BAND + i]
    index_out, index_in = index_of(borders, band, -1), index_of(borders, band, 0)
    for _ in range(_MAX_AIR_BOUNCES):
        reach = 4.0 * (lx + ly)
        if uz > 0.0:
            reach = (borders.table[0, SAFE_TOP] + 1e-3 - z) / uz
        elif uz < 0.0:
            reach = min(reach, z / -uz + 1e-3)
        if reach <= 0.0:
            break
        s = first_hit(relief.heights[0], relief.bounds[0], lx, ly, x, y, z, ux, uy, uz, reach, -1.0)
        if s < 0.0:
            break
        x, y, z = x + ux * s, y + uy * s, z + uz * s
        nx, ny, nz = rough_normal(relief.heights[0], lx, ly, x, y)
        cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
        is_reflected, cos_t = split(w, i, cos_i, index_out, index_in)
        if not is_reflected:
            ux, uy, uz = refract(ux, uy, uz, nx, ny, nz, index_out / index_in, cos_i, cos_t)
            return True, x, y, z, ux, uy, uz
        ux, uy, uz = reflect(ux, uy, uz, nx, ny, nz)
    return False, x, y, z, ux, uy, uz


@inlined_kernel
def _wrapped(x, period):
    """x in [0, period]; a division only where it is outside."""
    return x if 0.0 <= x < period else x - period * math.floor(x / period)


@inlined_kernel
def place(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, rough_border, inside_sign):
    """Puts lane i at (x, y, z) in a region; on a height field just inside, measured at the rounded position."""
    lx, ly = borders.lx, borders.ly
    if borders.sides == PERIODIC:
        x, y = _wrapped(x, lx), _wrapped(y, ly)
    f[X + i] = min(max(x, 0.0), lx)
    f[Y + i] = min(max(y, 0.0), ly)
    if relief is not None:
        if rough_border >= 0:
            h = height(relief.heights[rough_border], lx, ly, np.float64(f[X + i]), np.float64(f[Y + i]))
            z = h + inside_sign * OFFSET_MM
    f[Z + i] = z
    f[M + i] = majorant_depth(majorant, w[BAND + i], z)
    f[UX + i], f[UY + i], f[UZ + i] = ux, uy, uz
    f[Z_SAFE_TOP + i] = borders.table[region, SAFE_TOP]
    f[Z_SAFE_BOTTOM + i] = borders.table[region, SAFE_BOTTOM]
    w[REGION + i] = region


@inlined_kernel
def cross(f, w, i, borders, majorant, relief):
    """For one of the few lanes that may have met a border: where, and what becomes of the photon there.

    Returns INSIDE, LEFT_TOP, LEFT_BOTTOM or LEFT_SIDE. A lane that met none keeps its flight (BORDER = 0).
    """
    region = np.int64(w[REGION + i])
    path = np.float64(f[PATH + i])
    z = np.float64(f[Z_START + i])
    ux, uy, uz = np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i])
    x, y = np.float64(f[X + i]) - ux * path, np.float64(f[Y + i]) - uy * path
    dz = (np.float64(f[Z + i]) - z) / path if path > 0.0 else uz

    hit, k, side = -1.0, region, np.int64(1)
    if min(f[Z_START + i], f[Z + i]) < f[Z_SAFE_TOP + i]:
        hit = border_distance(borders, relief, region, np.int64(1), x, y, z, ux, uy, dz, path)
    if max(f[Z_START + i], f[Z + i]) > f[Z_SAFE_BOTTOM + i]:
        lower = border_distance(borders, relief, region + 1, np.int64(-1), x, y, z, ux, uy, dz, path)
        if lower >= 0.0 and (hit < 0.0 or lower < hit):
            hit, k, side = lower, region + 1, -1
    wall_x, wall_y = 0.0, 0.0
    if borders.sides != PERIODIC:
        s, wall_x, wall_y = side_distance(borders, x, y, ux, uy, path)
        if s <= path and (hit < 0.0 or s < hit):
            hit, side = s, 0
    if hit < 0.0:
        w[BORDER + i] = 0
        return INSIDE

    x, y, z = x + ux * hit, y + uy * hit, z + dz * hit
    if side == 0:
        return meet_side(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, wall_x, wall_y)
    return meet_border(f, w, i, borders, majorant, relief, region, k, side, x, y, z, ux, uy, uz)


@kernel
def meet_side(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, wall_x, wall_y):
    """A photon at a side of the patch: leaves an open one, is drawn by Fresnel at a dielectric one."""
    if borders.sides == OPEN:
        return LEFT_SIDE
    cos_i = min(1.0, abs(ux * wall_x + uy * wall_y))
    band = w[BAND + i]
    is_reflected, _ = split(w, i, cos_i, index_of(borders, band, region), index_of(borders, band, -1))
    if not is_reflected:
        return LEFT_SIDE
    ux, uy, uz = reflect(ux, uy, uz, wall_x, wall_y, 0.0)
    w[FRESH + i] &= ~STRAIGHT
    place(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, np.int64(-1), 0.0)
    return INSIDE


@inlined_kernel
def meet_border(f, w, i, borders, majorant, relief, region, k, side, x, y, z, ux, uy, uz):
    """A photon at border k, coming from below (side = 1) or above (-1): reflected, on to the next region, or out."""
    rough = -1
    nx, ny, nz = 0.0, 0.0, -np.float64(side)
    if relief is not None:
        rough = int(borders.table[k, ROUGH])
        if rough >= 0:
            dx, dy, dz = rough_normal(relief.heights[rough], borders.lx, borders.ly, x, y)
            nx, ny, nz = -side * dx, -side * dy, -side * dz
    if rough < 0:
        z = borders.table[k, BORDER_Z]
    band = w[BAND + i]
    index_from, index_to = index_of(borders, band, region), index_of(borders, band, region - side)
    cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
    is_reflected, cos_t = split(w, i, cos_i, index_from, index_to)
    into, inside_sign, left = region, np.float64(side), INSIDE
    if is_reflected:
        ux, uy, uz = reflect(ux, uy, uz, nx, ny, nz)
    else:
        ux, uy, uz = refract(ux, uy, uz, nx, ny, nz, index_from / index_to, cos_i, cos_t)
        into, inside_sign = region - side, -inside_sign
        if side < 0 and k == borders.table.shape[0] - 1:
            left = LEFT_BOTTOM
        elif side > 0 and k == 0:
            into, inside_sign, left = np.int64(0), 1.0, LEFT_TOP
            if relief is not None:
                if rough >= 0:
                    entered, x, y, z, ux, uy, uz = enter_surface(w, i, borders, relief, x, y, z, ux, uy, uz)
                    left = INSIDE if entered else LEFT_TOP
    if left != INSIDE:
        f[X + i], f[Y + i], f[UX + i], f[UY + i], f[UZ + i] = x, y, ux, uy, uz
        return left
    w[FRESH + i] &= ~STRAIGHT
    place(f, w, i, borders, majorant, relief, into, x, y, z, ux, uy, uz, rough, inside_sign)
    return INSIDE
