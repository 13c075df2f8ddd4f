"""Borders between media of different index: the surface, inner borders, the bottom and the sides.

A border is hit exactly on its plane or height field, with that surface's own normal, never on a voxel's face; the
free path has no memory, so a flight simply ends on the border and the next one starts there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.fresnel import fresnel, reflect, refract
from skinrender.transport.height_field import first_hit, height, height_and_gradient
from skinrender.transport.lanes import BORDER, FRESH, LANES, M, PATH, REGION, STRAIGHT, UX, UY, UZ, X, Y, Z
from skinrender.transport.lanes import Z_SAFE_BOTTOM, Z_SAFE_TOP, Z_START
from skinrender.transport.rng import draw

PERIODIC, OPEN, DIELECTRIC = 0, 1, 2
INSIDE, LEFT_TOP, LEFT_BOTTOM, LEFT_SIDE = 0, 1, 2, 3
_ROUGH_OFFSET_MM = 1e-6  # a photon on a height field is put this far inside: above the rounding of float32 positions
_MAX_AIR_BOUNCES = 10_000


class Borders(NamedTuple):
    """Borders of R regions, top to bottom; z in mm from the top of the volume.

    z (R+1), rough (R+1): row of the border in the height fields or -1; index (R+2): refractive index of the outside,
    the regions, and below, in the band; safe_top, safe_bottom (R): no border of the region reaches between them.
    """

    z: np.ndarray
    rough: np.ndarray
    index: np.ndarray
    safe_top: np.ndarray
    safe_bottom: np.ndarray
    size: np.ndarray
    sides: int


class Relief(NamedTuple):
    """Height fields (n, hx, hy), mm from the top of the volume, and the bounds of their cells; None when all is flat.

    deepest, bend (LEVELS, n, hx, hy): largest z and largest second derivative (1/mm) of the field within 1, 2, 4, ...
    cells of a cell: most short flights near the surface are thereby known to miss it without being followed.
    """

    heights: np.ndarray
    cell_min: np.ndarray
    cell_max: np.ndarray
    deepest: np.ndarray
    bend: np.ndarray


class Majorant(NamedTuple):
    """Slabs of constant majorant: z (mm) and optical depth of their upper edges, majorant (1/mm)."""

    z: np.ndarray
    depth: np.ndarray
    mu_t: np.ndarray


@kernel
def majorant_depth(majorant, z):
    """Majorant optical depth at depth z (mm)."""
    k = majorant.z.size - 1
    while k > 0 and z < majorant.z[k]:
        k -= 1
    return majorant.depth[k] + (z - majorant.z[k]) * majorant.mu_t[k]


@kernel
def split(words, lane, cos_i, index_from, index_to):
    """Fresnel at a smooth border, drawn, not weighted: (is reflected, cosine of the refracted ray)."""
    if index_from == index_to:
        return False, cos_i
    reflectance, cos_t = fresnel(cos_i, index_from / index_to)
    if reflectance >= 1.0:
        return True, 0.0
    return draw(words, lane, LANES) < reflectance, cos_t


@kernel
def rough_normal(heights, lx, ly, x, y):
    """Unit normal of a height field that points down into the layer below it."""
    _, hx, hy = height_and_gradient(heights, lx, ly, x, y)
    inverse = 1.0 / math.sqrt(hx * hx + hy * hy + 1.0)
    return -hx * inverse, -hy * inverse, inverse


@kernel
def stays_below(f, i, relief, row, lx, ly):
    """Whether the flight of lane i surely stays below height field `row`.

    It does below the deepest point around; and if it ends below the surface by more than the surface can bend away
    from its chord in between, (largest second derivative) x (lateral length)^2 / 8.
    """
    hx, hy = relief.heights.shape[1], relief.heights.shape[2]
    path = f[PATH + i]
    dx, dy = abs(f[UX + i]) * path, abs(f[UY + i]) * path
    reach = max(dx * (hx / lx), dy * (hy / ly))
    level, cells = 0, 1.0
    while reach > cells:
        level += 1
        cells *= 2.0
        if level == relief.deepest.shape[0]:
            return False
    x, y = np.float64(f[X + i]), np.float64(f[Y + i])
    a = min(max(int(x * (hx / lx)), 0), hx - 1)
    b = min(max(int(y * (hy / ly)), 0), hy - 1)
    if min(f[Z_START + i], f[Z + i]) > relief.deepest[level, row, a, b]:
        return True
    bend = relief.bend[level, row, a, b] * (dx * dx + dy * dy) * 0.125 + 2.0 * _ROUGH_OFFSET_MM
    if f[Z + i] - height(relief.heights[row], lx, ly, x, y) <= bend:
        return False
    x, y = x - np.float64(f[UX + i]) * path, y - np.float64(f[UY + i]) * path
    return f[Z_START + i] - height(relief.heights[row], lx, ly, x, y) > bend


@kernel
def border_distance(borders, relief, k, side, x, y, z, dx, dy, dz, path):
    """Path length at which the flight (x, y, z) + s (dx, dy, dz), s in (0, path], meets border k, or -1.

    side = +1: the flight starts below the border, -1: above it.
    """
    if relief is not None:
        row = borders.rough[k]
        if row >= 0:
            return first_hit(
                relief.heights[row], relief.cell_min[row], relief.cell_max[row], borders.size[0], borders.size[1],
                x, y, z, dx, dy, dz, path, np.float64(side),
            )
    end = z + dz * path
    if side > 0:
        if end >= borders.z[k]:
            return -1.0
    elif end <= borders.z[k]:
        return -1.0
    return max(0.0, min(path, (borders.z[k] - z) / dz))


@kernel
def side_distance(borders, x, y, dx, dy, path):
    """Path length at which the flight leaves the patch sideways (or path + 1), and the wall's normal (inwards)."""
    best, nx, ny = path + 1.0, 0.0, 0.0
    if dx < 0.0 and x + dx * path < 0.0:
        best, nx, ny = max(0.0, -x / dx), 1.0, 0.0
    elif dx > 0.0 and x + dx * path > borders.size[0]:
        best, nx, ny = max(0.0, (borders.size[0] - x) / dx), -1.0, 0.0
    s = path + 1.0
    if dy < 0.0 and y + dy * path < 0.0:
        s = max(0.0, -y / dy)
    elif dy > 0.0 and y + dy * path > borders.size[1]:
        s = max(0.0, (borders.size[1] - y) / dy)
    if s < best:
        best, nx, ny = s, 0.0, -1.0 if dy > 0.0 else 1.0
    return best, nx, ny


@kernel
def enter_surface(words, lane, borders, relief, x, y, z, ux, uy, uz, started):
    """Follows a photon in the air above the skin until it enters or escapes upwards.

    Returns (entered, reflections, x, y, z, ux, uy, uz). A flat surface is met at z = border 0; `started` says that the
    photon starts on the surface (it has just left it) and not at the top of the volume.
    """
    lx, ly = borders.size[0], borders.size[1]
    index_out, index_in = borders.index[0], borders.index[1]
    bounces = 0
    rough = False
    if relief is not None:
        rough = borders.rough[0] >= 0
    while bounces < _MAX_AIR_BOUNCES:
        nx, ny, nz = 0.0, 0.0, 1.0
        if rough:
            if relief is not None:
                reach = 4.0 * (lx + ly)
                if uz > 0.0:
                    reach = min(reach, (borders.safe_top[0] + 1e-3 - z) / uz)
                elif uz < 0.0:
                    reach = min(reach, z / -uz + 1e-3)
                if reach <= 0.0:
                    return False, bounces, x, y, z, ux, uy, uz
                s = first_hit(
                    relief.heights[0], relief.cell_min[0], relief.cell_max[0], lx, ly, x, y, z, ux, uy, uz, reach, -1.0
                )
                if s < 0.0:
                    return False, bounces, x, y, z, ux, uy, uz
                x, y, z = x + ux * s, y + uy * s, z + uz * s
                nx, ny, nz = rough_normal(relief.heights[0], lx, ly, x, y)
        elif started:
            return False, bounces, x, y, z, ux, uy, uz
        else:
            s = (borders.z[0] - z) / uz
            x, y, z = x + ux * s, y + uy * s, borders.z[0]
        cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
        is_reflected, cos_t = split(words, lane, cos_i, index_out, index_in)
        if not is_reflected:
            ux, uy, uz = refract(ux, uy, uz, nx, ny, nz, index_out / index_in, cos_i, cos_t)
            return True, bounces, x, y, z, ux, uy, uz
        bounces += 1
        ux, uy, uz = reflect(ux, uy, uz, nx, ny, nz)
        if not rough:
            return False, bounces, x, y, z, ux, uy, uz
    return False, bounces, x, y, z, ux, uy, uz


@kernel
def place(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, rough_border, inside_sign):
    """Puts lane i at (x, y, z) in a region; on a height field just inside, measured at the rounded position."""
    lx, ly = borders.size[0], borders.size[1]
    if borders.sides == PERIODIC:
        x -= lx * math.floor(x / lx)
        y -= ly * math.floor(y / ly)
    f[X + i] = min(max(x, 0.0), lx)
    f[Y + i] = min(max(y, 0.0), ly)
    if relief is not None:
        if rough_border >= 0:
            h = height(relief.heights[rough_border], lx, ly, np.float64(f[X + i]), np.float64(f[Y + i]))
            z = h + inside_sign * _ROUGH_OFFSET_MM
    f[Z + i] = z
    f[M + i] = majorant_depth(majorant, z)
    f[UX + i], f[UY + i], f[UZ + i] = ux, uy, uz
    f[Z_SAFE_TOP + i] = borders.safe_top[region]
    f[Z_SAFE_BOTTOM + i] = borders.safe_bottom[region]
    w[REGION + i] = region


@kernel
def cross(f, w, i, borders, majorant, relief):
    """Second pass, for the few lanes that may have met a border: where, and what becomes of the photon there.

    Returns INSIDE, LEFT_TOP, LEFT_BOTTOM or LEFT_SIDE. A lane that met none keeps its flight (BORDER = 0).
    """
    region = w[REGION + i]
    if relief is not None:
        row = borders.rough[region]
        if row >= 0 and max(f[Z_START + i], f[Z + i]) <= f[Z_SAFE_BOTTOM + i] and borders.sides == PERIODIC:
            if stays_below(f, i, relief, row, borders.size[0], borders.size[1]):
                w[BORDER + i] = 0
                return INSIDE
    path = np.float64(f[PATH + i])
    z = np.float64(f[Z_START + i])
    ux, uy, uz = np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i])
    x, y = np.float64(f[X + i]) - ux * path, np.float64(f[Y + i]) - uy * path
    dz = (np.float64(f[Z + i]) - z) / path if path > 0.0 else uz

    hit, k, side = border_distance(borders, relief, region, 1, x, y, z, ux, uy, dz, path), region, 1
    if hit < 0.0 or relief is not None:
        lower = border_distance(borders, relief, region + 1, -1, x, y, z, ux, uy, dz, path)
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
    is_reflected, _ = split(w, i, cos_i, borders.index[region + 1], borders.index[0])
    if not is_reflected:
        return LEFT_SIDE
    ux, uy, uz = reflect(ux, uy, uz, wall_x, wall_y, 0.0)
    w[FRESH + i] &= ~STRAIGHT
    place(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, -1, 0.0)
    return INSIDE


@kernel
def meet_border(f, w, i, borders, majorant, relief, region, k, side, x, y, z, ux, uy, uz):
    """A photon at border k, coming from below (side = 1) or above (-1): reflected, on to the next region, or out."""
    rough = -1
    nx, ny, nz = 0.0, 0.0, -np.float64(side)
    if relief is not None:
        rough = borders.rough[k]
        if rough >= 0:
            dx, dy, dz = rough_normal(relief.heights[rough], borders.size[0], borders.size[1], x, y)
            nx, ny, nz = -side * dx, -side * dy, -side * dz
    if rough < 0:
        z = borders.z[k]
    index_from, index_to = borders.index[region + 1], borders.index[region + 1 - side]
    cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
    is_reflected, cos_t = split(w, i, cos_i, index_from, index_to)
    if is_reflected:
        w[FRESH + i] &= ~STRAIGHT
        ux, uy, uz = reflect(ux, uy, uz, nx, ny, nz)
        place(f, w, i, borders, majorant, relief, region, x, y, z, ux, uy, uz, rough, np.float64(side))
        return INSIDE
    ux, uy, uz = refract(ux, uy, uz, nx, ny, nz, index_from / index_to, cos_i, cos_t)
    if side < 0 and k == borders.z.size - 1:
        f[X + i], f[Y + i], f[UX + i], f[UY + i], f[UZ + i] = x, y, ux, uy, uz
        return LEFT_BOTTOM
    if side < 0 or k > 0:
        w[FRESH + i] &= ~STRAIGHT
        place(f, w, i, borders, majorant, relief, region - side, x, y, z, ux, uy, uz, rough, -np.float64(side))
        return INSIDE
    entered, _, x, y, z, ux, uy, uz = enter_surface(
        w, i, borders, relief, x, y, z, ux, uy, uz, True
    )
    if not entered:
        f[X + i], f[Y + i], f[UX + i], f[UY + i], f[UZ + i] = x, y, ux, uy, uz
        return LEFT_TOP
    w[FRESH + i] &= ~STRAIGHT
    place(f, w, i, borders, majorant, relief, 0, x, y, z, ux, uy, uz, rough, 1.0)
    return INSIDE
