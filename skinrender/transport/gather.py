"""Between flight and collision: what tissue each lane has arrived in.

All look-ups in the volume's tables are here, each a pass of its own, as are the few operations between them, which
vectorize: loops of two and three look-ups that depend on each other took 1.6 times as long, as the processor overlaps fewer lanes.

The volume is read through bricks of 16 x 16 columns of one voxel plane: a uniform brick is one palette entry, so that a
walk reads a quarter of the volume or less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import block_kernel, kernel
from skinrender.transport.caches import prefetch
from skinrender.transport.lanes import (
    ABSORB_ABOVE,
    BAND,
    BAND_PLANE,
    BRICK,
    BRICKS,
    EDGE,
    ENTRY,
    IN_BRICK,
    PLANE,
    SCATTER_BELOW,
    TISSUE,
    VOXEL,
    G,
    Z,
    look_up,
)
from skinrender.transport.vectors import DEALT, deal_rows


class Grid(NamedTuple):
    """The voxels, for all bands alike.

    coarse_plane (cells,) int32: first plane of each coarse depth cell; edges_in_cell: most edges of planes that lie
    between that plane and a depth in the cell, 0 where cells end on all edges (to a rounding of the depth); next_edge
    (planes,): lower edge of each plane, mm from the top, the last one infinite; brick (bricks_x * bricks_y * planes) int32,
    those of a column together: where it begins in `palette`, of a brick that is not uniform with the sign bit set too;
    palette uint16: the entries in order, which uniform bricks share, then the voxels of the other bricks.
    """

    coarse_plane: np.ndarray
    edges_in_cell: int
    next_edge: np.ndarray
    brick: np.ndarray
    palette: np.ndarray
    bricks_y: int
    planes: int


MOST_VOXELS = np.int32(2**31 - 1)
"""In `Grid.palette`; also the bits of a brick that say where it begins."""
ROW = 4
"""Words of a row of `Medium.rows`: thresholds of the collision's word, bits of the float32 anisotropy, tissue layer."""


@kernel
def find_planes(f, w, n, grid):
    """Sets PLANE, until now the coarse depth cell, of n lanes.

    The edges within a cell are counted, not searched: a `while` doubled the time of all this file.
    """
    look_up(grid.coarse_plane, w, PLANE, w, PLANE, n)
    for _ in range(grid.edges_in_cell):
        look_up(grid.next_edge, w, PLANE, f, EDGE, n)
        step_down(f, w, n)


@block_kernel
def step_down(f, w, n):
    """To the next plane in lanes that are below the edge of theirs."""
    for i in range(n):
        w[PLANE + i] += np.int32(1) if f[Z + i] >= f[EDGE + i] else np.int32(0)


@kernel
def find_voxels(w, n, grid):
    """Sets VOXEL, the place in `Grid.palette`, of n lanes.

    The palette is the one table larger than the cache: asked for here, it is there for `gather`, which under a relief
    takes 0.8 ns less then.
    """
    choose_bricks(w, n)
    look_up(grid.brick, w, BRICKS, w, BRICK, n)
    enter_bricks(w, n)
    for i in range(n):
        prefetch(grid.palette, np.uint64(w[VOXEL + i]))


@block_kernel
def choose_bricks(w, n):
    """Of the bricks of a column those of the lanes' planes."""
    for i in range(n):
        w[BRICKS + i] += w[PLANE + i]


@block_kernel
def enter_bricks(w, n):
    """Place of a voxel in the palette: in a uniform brick, that of the brick."""
    for i in range(n):
        brick = w[BRICK + i]
        is_varied = np.int32(brick >> np.int32(31))
        w[VOXEL + i] = np.int32(np.int32(brick & MOST_VOXELS) + np.int32(w[IN_BRICK + i] & is_varied))


@kernel
def gather(f, w, n, grid, plane_row, rows):
    """Sets the thresholds, anisotropy and tissue layer of n lanes, a multiple of DEALT.

    rows (ROW .,) int32; plane_row (B planes,): first row of a band and plane's majorant slab. A row is read by one load
    and dealt with those of the next three lanes: 0.3 ns, and 1.05 word by word, as there is but one store a cycle.
    """
    count_planes(w, n, grid.planes)
    look_up(plane_row, w, BAND_PLANE, w, BAND_PLANE, n)
    look_up(grid.palette, w, VOXEL, w, ENTRY, n)
    choose_rows(w, n)
    for i in range(0, n, DEALT):
        a, b = np.uint64(w[ENTRY + i]), np.uint64(w[ENTRY + i + 1])
        c, d = np.uint64(w[ENTRY + i + 2]), np.uint64(w[ENTRY + i + 3])
        at = np.uint64(i)
        deal_rows(
            rows, a, b, c, d, w, np.uint64(SCATTER_BELOW) + at, np.uint64(ABSORB_ABOVE) + at, np.uint64(TISSUE) + at, f,
            np.uint64(G) + at
        )


@block_kernel
def count_planes(w, n, planes):
    """The lanes' planes among those of all bands."""
    planes = np.int32(planes)
    for i in range(n):
        w[BAND_PLANE + i] = np.int32(np.int32(planes * w[BAND + i]) + w[PLANE + i])


@block_kernel
def choose_rows(w, n):
    """Of the rows of a slab those of the lanes' palette entries."""
    for i in range(n):
        w[ENTRY + i] = np.int32(np.int32(ROW) * np.int32(w[BAND_PLANE + i] + w[ENTRY + i]))
