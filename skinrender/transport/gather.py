"""Between flight and collision: what tissue each lane has arrived in.

The only pass with table look-ups: a gather beside arithmetic would stop the other passes from vectorizing. The volume
is read through bricks of 16 x 16 columns of one voxel plane: a uniform brick is one palette entry, so that a walk
reads a quarter of the volume or less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import inlined_kernel, kernel
from skinrender.transport.caches import prefetch
from skinrender.transport.lanes import ABSORB_ABOVE, BAND, BRICKS, IN_BRICK, PLANE, SCATTER_BELOW, TISSUE, VOXEL, G, Z
from skinrender.transport.vectors import DEALT, deal_rows


class Grid(NamedTuple):
    """The voxels, for all bands alike.

    plane_edge (planes + 1): z of the voxel planes, mm from the top, the last one infinite; coarse_plane: first plane of
    each coarse depth cell; edges_in_cell: most edges that lie between that plane and a depth in the cell; brick
    (bricks_x * bricks_y * planes) int32, those of a column together: where it begins in `palette`, of a brick that is not
    uniform with the sign bit set too; palette uint16: the entries in order, which uniform bricks share, then the voxels of
    the other bricks.
    """

    plane_edge: np.ndarray
    coarse_plane: np.ndarray
    edges_in_cell: int
    brick: np.ndarray
    palette: np.ndarray
    bricks_y: int
    planes: int


MOST_VOXELS = np.int32(2**31 - 1)
ROW = 4
"""Words of a row of `Medium.rows`: thresholds of the collision's word, bits of the float32 anisotropy, tissue layer."""


@kernel
def find_voxels(f, w, n, grid):
    """Sets PLANE, until now the coarse depth cell, and VOXEL, the place in `Grid.palette`, of n lanes.

    Indices are unsigned: numba's test for negative ones costs as much as the look-up. The edges within a coarse cell
    are counted, not searched: a `while` in this loop doubled its time. In a uniform brick the place is masked out, as
    of a product with 0 or 1 LLVM makes a branch, which near the surface is guessed wrong again and again. The palette is
    the one table larger than the cache: asked for here, it is there for `gather`, which takes 3 ns under a relief
    in place of 5 to 10.
    """
    edge, coarse_plane, brick_of, palette = grid.plane_edge, grid.coarse_plane, grid.brick, grid.palette
    more_edges, one = grid.edges_in_cell - 1, np.uint64(1)
    for i in range(n):
        plane = np.uint64(coarse_plane[np.uint64(w[PLANE + i])])
        z = f[Z + i]
        plane += np.uint64(z >= edge[plane + one])
        for _ in range(more_edges):
            plane += np.uint64(z >= edge[plane + one])
        brick = brick_of[np.uint64(w[BRICKS + i]) + plane]
        w[PLANE + i] = plane
        is_varied = np.int32(brick >> np.int32(31))
        voxel = np.uint64(np.int32(brick & MOST_VOXELS) + np.int32(w[IN_BRICK + i] & is_varied))
        prefetch(palette, voxel)
        w[VOXEL + i] = voxel


@inlined_kernel
def row_of(w, i, palette, planes, plane_row):
    """Place in `Medium.rows` of what a collision of lane i reads."""
    first = plane_row[np.uint64(w[BAND + i]) * planes + np.uint64(w[PLANE + i])]
    return np.uint64(ROW) * (np.uint64(first) + np.uint64(palette[np.uint64(w[VOXEL + i])]))


@kernel
def gather(f, w, n, grid, plane_row, rows):
    """Sets the thresholds, anisotropy and tissue layer of n lanes, a multiple of DEALT.

    rows (ROW .,) int32; plane_row (B planes,): first row of a band and plane's majorant slab. A row is read by one load and
    dealt with those of the next three lanes: word by word the pass took 1.3 ns in place of 0.85, as there is but one store a cycle.
    """
    palette, planes = grid.palette, np.uint64(grid.planes)
    for i in range(0, n, DEALT):
        a, b = row_of(w, i, palette, planes, plane_row), row_of(w, i + 1, palette, planes, plane_row)
        c, d = row_of(w, i + 2, palette, planes, plane_row), row_of(w, i + 3, palette, planes, plane_row)
        at = np.uint64(i)
        deal_rows(
            rows, a, b, c, d, w, np.uint64(SCATTER_BELOW) + at, np.uint64(ABSORB_ABOVE) + at, np.uint64(TISSUE) + at, f,
            np.uint64(G) + at
        )
