"""Between flight and collision: what tissue each lane has arrived in.

The only pass with table look-ups: a gather beside arithmetic would stop the other passes from vectorizing. The volume
is read through bricks of 16 x 16 columns of one voxel plane: a uniform brick is one palette entry, so that a walk
touches some kilobytes, not the whole volume (the largest single cost of all: 1.9 to 2.9 times the floor against 1.5).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.lanes import ABSORB_ABOVE, BORDER, G, IX, IY, IZ, SCATTER_BELOW, TISSUE, Z

BRICK_BITS = 4
BRICK = 1 << BRICK_BITS
NEVER_SCATTER, NEVER_ABSORB = np.int32(-(2**31)), np.int32(2**31 - 1)


class Grid(NamedTuple):
    """The voxels, for all bands alike.

    plane_edge (planes+1) z of the voxel planes, mm from the top; coarse_plane: first plane of each coarse depth cell;
    brick (planes * bricks_x * bricks_y) uint32: 2 * offset into `palette` + 1 if the brick varies; palette uint16.
    """

    plane_edge: np.ndarray
    coarse_plane: np.ndarray
    brick: np.ndarray
    palette: np.ndarray
    bricks_x: int
    bricks_y: int


@kernel
def plane_of(grid, coarse, z):
    """Index of the voxel plane that holds depth z, starting from the first plane of its coarse cell."""
    plane = grid.coarse_plane[coarse]
    last = grid.plane_edge.size - 2
    while plane < last and z >= grid.plane_edge[plane + 1]:
        plane += 1
    return plane


@kernel
def palette_entry(grid, ix, iy, plane):
    """Palette index of the voxel (ix, iy, plane)."""
    brick = grid.brick[(plane * grid.bricks_x + (ix >> BRICK_BITS)) * grid.bricks_y + (iy >> BRICK_BITS)]
    local = ((ix & (BRICK - 1)) << BRICK_BITS) + (iy & (BRICK - 1))
    return grid.palette[(brick >> np.uint32(1)) + (brick & np.uint32(1)) * np.uint32(local)]


@kernel
def gather(f, w, n, grid, plane_slab, thresholds, anisotropy, layer):
    """Sets the thresholds, anisotropy and tissue layer of n lanes; a lane that ended on a border can't collide.

    thresholds (slabs, P, 2) int32 and anisotropy (P,) of the band; plane_slab (planes): majorant slab of a plane;
    layer (P,): tissue layer of a palette entry.
    """
    for i in range(n):
        if w[BORDER + i] != 0:
            w[SCATTER_BELOW + i] = NEVER_SCATTER
            w[ABSORB_ABOVE + i] = NEVER_ABSORB
            continue
        plane = plane_of(grid, w[IZ + i], f[Z + i])
        entry = palette_entry(grid, w[IX + i], w[IY + i], plane)
        slab = plane_slab[plane]
        w[SCATTER_BELOW + i] = thresholds[slab, entry, 0]
        w[ABSORB_ABOVE + i] = thresholds[slab, entry, 1]
        f[G + i] = anisotropy[entry]
        w[TISSUE + i] = layer[entry]
