"""Borders that are height fields, as a flight sees them: its normal, and whether it can be met at all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.height_field import height, height_and_gradient
from skinrender.transport.lanes import PATH, UX, UY, Z_START, X, Y, Z

OFFSET_MM = 1e-6  # a photon on a height field is put this far inside: above the rounding of float32 positions
# Columns of `Relief.cells`
CELL_MIN, CELL_MAX, DEEPEST, BEND = 0, 1, 2, 6
RELIEF_LEVELS = 4
RELIEF_COLUMNS = BEND + RELIEF_LEVELS


class Relief(NamedTuple):
    """Height fields (n, hx, hy), mm from the top of the volume, and what is known of their cells; None when all is flat.

    cells (n, hx, hy, RELIEF_COLUMNS) holds the bounds of the cell's patch, then for 1, 2, 4, 8 cells around it the
    largest z and the largest second derivative (1/mm): most short flights near the surface are thereby known to miss
    it without being followed.
    """

    heights: np.ndarray
    cells: np.ndarray


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
        if level == RELIEF_LEVELS:
            return False
    x, y = np.float64(f[X + i]), np.float64(f[Y + i])
    a = min(max(int(x * (hx / lx)), 0), hx - 1)
    b = min(max(int(y * (hy / ly)), 0), hy - 1)
    if min(f[Z_START + i], f[Z + i]) > relief.cells[row, a, b, DEEPEST + level]:
        return True
    bend = relief.cells[row, a, b, BEND + level] * (dx * dx + dy * dy) * 0.125 + 2.0 * OFFSET_MM
    if f[Z + i] - height(relief.heights[row], lx, ly, x, y) <= bend:
        return False
    x, y = x - np.float64(f[UX + i]) * path, y - np.float64(f[UY + i]) * path
    return f[Z_START + i] - height(relief.heights[row], lx, ly, x, y) > bend
