"""Borders that are height fields, as a flight sees them: its normal, and whether it can be met at all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.transport import block_kernel, inlined_kernel, kernel
from skinrender.transport.height_field import height_and_gradient
from skinrender.transport.lanes import BORDER, LISTED, OVER, PATH, REGION, UX, UY, Z_SAFE_BOTTOM, Z_START, X, Y, Z

OFFSET_MM = 1e-6  # a photon on a height field is put this far inside: above the rounding of float32 positions
ROUGH = 1  # column of `borders.Borders.table`: row of the border in the height fields, or -1
TILE = 4  # cells
NEAR = 2  # cells around that of a flight's middle that it may cross; longer flights are held against the whole field
DEEPEST, BULGE = 0, 1  # columns of `Relief.around`
SAMPLE_BYTES = 20  # that a `Relief` holds of a sample of a height field, with what is needed to make it
_NEAR, _HALF = np.float32(0.99 * NEAR / TILE), np.float32(0.5)  # less than NEAR: the middle is rounded


class Relief(NamedTuple):
    """Height fields (n, hx, hy) float32, mm from the top of the volume, and what is known around their cells.

    bounds (n, hx, hy, 2): lowest and highest z of each cell. around (n, tiles + 1, 2) float32: within NEAR cells of those of
    each tile, and last everywhere, the largest z and the largest second derivative (1/mm) with which the surface bends down;
    most flights near the surface are thereby known to miss it without being followed.
    """

    heights: np.ndarray
    bounds: np.ndarray
    around: np.ndarray
    tiles_per_mm: np.ndarray
    last_tile: np.ndarray


@kernel
def rough_normal(heights, lx, ly, x, y):
    """Unit normal of a height field that points down into the layer below it."""
    _, hx, hy = height_and_gradient(heights, lx, ly, x, y)
    inverse = 1.0 / math.sqrt(hx * hx + hy * hy + 1.0)
    return -hx * inverse, -hy * inverse, inverse


@block_kernel
def look_around(f, w, n, lx, ly, tiles_per_mm, last_tile):
    """Row of `Relief.around` that holds for each flight: the tile of its middle, if both ends are near that."""
    sx, sy, mx, my = tiles_per_mm[0], tiles_per_mm[1], last_tile[0], last_tile[1]
    zero, across = np.int32(0), np.int32(my + np.int32(1))
    everywhere, nothing = np.int32(np.int32(mx + np.int32(1)) * across), lx - lx
    for i in range(n):
        half = _HALF * f[PATH + i]
        dx, dy = f[UX + i] * half, f[UY + i] * half
        x, y = f[X + i] - dx, f[Y + i] - dy
        x += (lx if x < nothing else nothing) - (lx if x > lx else nothing)
        y += (ly if y < nothing else nothing) - (ly if y > ly else nothing)
        a = min(max(np.int32(x * sx), zero), mx)
        b = min(max(np.int32(y * sy), zero), my)
        here = np.int32(np.int32(a * across) + b)
        w[OVER + i] = everywhere if max(abs(dx) * sx, abs(dy) * sy) > _NEAR else here


@kernel
def clear_by_depth(f, w, marked, borders, relief):
    """Clears the mark of flights that are deeper than the height field over their region is anywhere around; returns
    how many stay marked.

    The lanes are those that `list_lanes` lists. Without branches, as `clear_by_bulge`: which flights pass is so
    random that wrong guesses cost more than the tests.
    """
    left = np.uint64(LISTED)
    for k in range(marked):
        i = np.int64(np.uint32(w[LISTED + k]))
        row = int(borders.table[np.uint64(np.uint32(w[REGION + i])), ROUGH])
        clear = (row >= 0) & (max(f[Z_START + i], f[Z + i]) <= f[Z_SAFE_BOTTOM + i])
        clear &= below_all_around(f, w, i, relief.around, max(row, 0))
        w[BORDER + i] = np.int32(not clear)
        w[left] = i
        left += np.uint64(not clear)
    return left - np.uint64(LISTED)


@kernel
def clear_by_bulge(f, w, marked, borders, relief):
    """Clears the mark of flights that pass below the height field over their region however it bulges; returns how many
    stay marked."""
    left = np.uint64(LISTED)
    for k in range(marked):
        i = np.int64(np.uint32(w[LISTED + k]))
        row = int(borders.table[np.uint64(np.uint32(w[REGION + i])), ROUGH])
        clear = (row >= 0) & (max(f[Z_START + i], f[Z + i]) <= f[Z_SAFE_BOTTOM + i])
        clear &= below_each_bulge(f, w, i, relief, max(row, 0), borders.lx, borders.ly)
        w[BORDER + i] = np.int32(not clear)
        w[left] = i
        left += np.uint64(not clear)
    return left - np.uint64(LISTED)


@inlined_kernel
def below_all_around(f, w, i, around, row):
    """Whether the flight of lane i is deeper than height field `row` is anywhere around."""
    return min(f[Z_START + i], f[Z + i]) > around[np.uint64(row), np.uint64(w[OVER + i]), DEEPEST]


@inlined_kernel
def below_each_bulge(f, w, i, relief, row, lx, ly):
    """Whether the flight of lane i passes below height field `row` however it bulges on the way.

    With a second derivative of at most B over the lateral length L, a depth q below the surface in the middle, and
    q + r at the end if the surface were a plane there, the depth is at least q t - B L^2 t (1 - t) / 8 on the first
    half, t in (0, 1), as the start is inside, and q + r t - B L^2 t^2 / 8 on the second.
    """
    half = 0.5 * np.float64(f[PATH + i])
    dx, dy = f[UX + i] * half, f[UY + i] * half
    x, y = np.float64(f[X + i]) - dx, np.float64(f[Y + i]) - dy
    h, slope_x, slope_y = height_and_gradient(relief.heights[np.uint64(row)], lx, ly, x, y)
    bulge = relief.around[np.uint64(row), np.uint64(w[OVER + i]), BULGE] * (dx * dx + dy * dy) * 0.5
    start, end = np.float64(f[Z_START + i]), np.float64(f[Z + i])
    q = 0.5 * (start + end) - h
    r = 0.5 * (end - start) - slope_x * dx - slope_y * dy
    return q + min(r, 0.0) > bulge + OFFSET_MM
