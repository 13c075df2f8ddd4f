"""Borders that are height fields, as a flight sees them: its normal, and whether it can be met at all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.transport import block_kernel, inlined_kernel, kernel
from skinrender.transport.height_field import height, height_and_gradient
from skinrender.transport.lanes import BORDER, LISTED, OVER, PATH, REGION, UX, UY, Z_SAFE_BOTTOM, Z_START, X, Y, Z

OFFSET_MM = 1e-6  # a photon on a height field is put this far inside: above the rounding of float32 positions
ROUGH = 1  # column of `borders.Borders.table`: row of the border in the height fields, or -1
NEAR, FAR = 1, 3  # cells around one that a flight may cross; longer flights are held against the whole field
DEEPEST, BULGE = 0, 1  # columns of `Relief.around`
SAMPLE_BYTES = 4 + 8 + 16  # that a `Relief` holds of a sample of a height field
_NEAR, _FAR = np.float32(NEAR), np.float32(FAR)


class Relief(NamedTuple):
    """Height fields (n, hx, hy) float64, mm from the top of the volume, and what is known around their cells.

    bounds (n, hx, hy, 2): lowest and highest z of each cell. around (n, hx hy LEVELS, 2) float32: within each of the
    `NEIGHBORHOODS` of a cell, and everywhere, the largest z and the largest second derivative (1/mm) with which the
    surface bends down; most flights near the surface are thereby known to miss it without being followed.
    """

    heights: np.ndarray
    bounds: np.ndarray
    around: np.ndarray
    cells_per_mm: np.ndarray
    last_cell: np.ndarray


@kernel
def rough_normal(heights, lx, ly, x, y):
    """Unit normal of a height field that points down into the layer below it."""
    _, hx, hy = height_and_gradient(heights, lx, ly, x, y)
    inverse = 1.0 / math.sqrt(hx * hx + hy * hy + 1.0)
    return -hx * inverse, -hy * inverse, inverse


@block_kernel
def look_around(f, w, n, cells_per_mm, last_cell):
    """Row of `Relief.around` that holds for each flight: the cell of its end, and a neighborhood that holds its
    start."""
    sx, sy, mx, my = cells_per_mm[0], cells_per_mm[1], last_cell[0], last_cell[1]
    zero, one, across = np.int32(0), np.int32(1), np.int32(my + np.int32(1))
    everywhere = np.int32(np.int32(np.int32(mx + one) * across) << one)
    for i in range(n):
        path = f[PATH + i]
        reach = max(abs(f[UX + i]) * path * sx, abs(f[UY + i]) * path * sy)
        a = min(max(np.int32(f[X + i] * sx), zero), mx)
        b = min(max(np.int32(f[Y + i] * sy), zero), my)
        here = np.int32(np.int32(np.int32(np.int32(a * across) + b) << one) + np.int32(reach > _NEAR))
        w[OVER + i] = everywhere if reach > _FAR else here


@kernel
def clear_of_relief(f, w, marked, borders, relief):
    """Clears the mark of flights that surely stay below the height field over their region; returns how many stay
    marked.

    The lanes are those that `walk.list_lanes` lists. Two tests, the cheap one first, each over the whole list and
    without branches: which flights pass is so random that wrong guesses cost more than the tests.
    """
    for by_depth in (True, False):
        left = np.uint64(0)
        for k in range(marked):
            i = w[LISTED + k]
            row = int(borders.table[w[REGION + i], ROUGH])
            clear = row >= 0 and max(f[Z_START + i], f[Z + i]) <= f[Z_SAFE_BOTTOM + i]
            if clear:
                if by_depth:
                    clear = below_all_around(f, w, i, relief.around, row)
                else:
                    clear = below_each_bulge(f, w, i, relief, row, borders.lx, borders.ly)
            w[BORDER + i] = np.int32(not clear)
            w[LISTED + left] = i
            left += np.uint64(not clear)
        marked = left
    return marked


@inlined_kernel
def below_all_around(f, w, i, around, row):
    """Whether the flight of lane i is deeper than height field `row` is anywhere around."""
    return min(f[Z_START + i], f[Z + i]) > around[np.uint64(row), np.uint64(w[OVER + i]), DEEPEST]


@inlined_kernel
def below_each_bulge(f, w, i, relief, row, lx, ly):
    """Whether the flight of lane i passes below height field `row` however it bulges between the flight's ends.

    With depths p and q below the surface at the ends and a second derivative of at most B over the lateral length L,
    the depth between is at least (1 - t) p + t q - B L^2 t (1 - t) / 2, and that is positive for all t in (0, 1) where
    sqrt(p) + sqrt(q) > sqrt(B L^2 / 2).
    """
    heights = relief.heights[np.uint64(row)]
    path = np.float64(f[PATH + i])
    dx, dy = f[UX + i] * path, f[UY + i] * path
    x, y = np.float64(f[X + i]), np.float64(f[Y + i])
    bulge = relief.around[np.uint64(row), np.uint64(w[OVER + i]), BULGE] * (dx * dx + dy * dy) * 0.5
    p = f[Z_START + i] - height(heights, lx, ly, x - dx, y - dy) - OFFSET_MM
    q = f[Z + i] - height(heights, lx, ly, x, y) - OFFSET_MM
    p = max(p, 0.0)  # a start on the surface is inside it, whatever rounding says
    return q > 0.0 and p + q + 2.0 * math.sqrt(p * q) > bulge
