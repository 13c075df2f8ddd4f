"""Between flight and collision: what tissue each lane has arrived in.

The only pass with table look-ups: a gather beside arithmetic would stop the other passes from vectorizing. The volume
is read through bricks of 16 x 16 columns of one voxel plane: a uniform brick is one palette entry, so that a walk
touches some kilobytes, not the whole volume (the largest single cost of all: 1.9 to 2.9 times the floor against 1.5).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.lanes import ABSORB_ABOVE, BRICK_XY, IN_BRICK, IZ, SCATTER_BELOW, TISSUE, G, Z


class Grid(NamedTuple):
    """The voxels, for all bands alike.

    plane_edge (planes + 1): z of the voxel planes, mm from the top, the last one infinite; coarse_plane: first plane of
    each coarse depth cell; brick (planes * bricks_x * bricks_y) uint32: 2 * offset into `palette` + 1 if the brick
    varies; palette uint16.
    """

    plane_edge: np.ndarray
    coarse_plane: np.ndarray
    brick: np.ndarray
    palette: np.ndarray
    bricks_x: int
    bricks_y: int


# Columns of a row of `Medium.rows`: thresholds of the collision's word, bits of the float32 anisotropy, tissue layer.
ROW_SCATTER, ROW_ABSORB, ROW_G, ROW_LAYER = 0, 1, 2, 3


@kernel
def gather(f, w, n, grid, plane_row, rows, rows_as_float):
    """Sets the thresholds, anisotropy and tissue layer of n lanes.

    rows (slabs * P, 4) int32 of the band and the same memory as float32; plane_row (planes,): first row of the plane's
    majorant slab. Indices are unsigned: numba's test for negative ones costs as much as the look-up.
    """
    edge, coarse_plane, brick_of, palette = grid.plane_edge, grid.coarse_plane, grid.brick, grid.palette
    per_plane, one = np.uint64(grid.bricks_x * grid.bricks_y), np.uint64(1)
    for i in range(n):
        plane = np.uint64(coarse_plane[np.uint64(w[IZ + i])])
        z = f[Z + i]
        plane += np.uint64(z >= edge[plane + one])  # mostly 0 or 1, and a branch would be guessed wrong at every border
        while z >= edge[plane + one]:
            plane += one
        brick = np.uint64(brick_of[plane * per_plane + np.uint64(w[BRICK_XY + i])])
        entry = palette[(brick >> one) + (brick & one) * np.uint64(w[IN_BRICK + i])]
        row = np.uint64(plane_row[plane]) + np.uint64(entry)
        w[SCATTER_BELOW + i] = rows[row, ROW_SCATTER]
        w[ABSORB_ABOVE + i] = rows[row, ROW_ABSORB]
        f[G + i] = rows_as_float[row, ROW_G]
        w[TISSUE + i] = rows[row, ROW_LAYER]
