"""Free flight of every lane (the paper's equation (2), across voxels of different extinction).

The majorant extinction depends on depth alone and is constant in at most `lanes.SLABS` slabs. With the majorant optical
depth m(z) as vertical coordinate a flight of optical length tau is one line, m' = m + u_z tau, exact across any number
of slabs; null collisions in `turn` correct the majorant to the voxel's own extinction (Woodcock et al. 1965).
4 to 5 slabs are the optimum in skin: one global majorant costs 2.5 times as much, stepping from voxel to voxel 2.7
times.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel
from skinrender.transport.blockmath import log_unit
from skinrender.transport.bricks import BRICK, BRICK_BITS
from skinrender.transport.lanes import (
    BORDER,
    BRICKS,
    FREE_PATH,
    IN_BRICK,
    LANES,
    PATH,
    PLANE,
    SLAB_DEPTH,
    UX,
    UY,
    UZ,
    WORDS,
    Z_SAFE_BOTTOM,
    Z_SAFE_TOP,
    Z_START,
    M,
    X,
    Y,
    Z,
)
from skinrender.transport.rng import next_word, uniform


@block_kernel
def fly(f, w, n):
    """Moves n lanes by one free path along their direction; sets PATH, Z_START and BORDER.

    Each lane has the slabs of its own band: SLAB_DEPTH, majorant optical depth of the lower edges but the last one's;
    FREE_PATH, reciprocal majorant of the first slab (mm), then its changes from slab to slab.
    """
    zero = f.dtype.type(0.0)
    for i in range(n):
        b1, b2 = f[SLAB_DEPTH + i], f[SLAB_DEPTH + LANES + i]
        b3, b4 = f[SLAB_DEPTH + 2 * LANES + i], f[SLAB_DEPTH + 3 * LANES + i]
        d0, d1, d2 = f[FREE_PATH + i], f[FREE_PATH + LANES + i], f[FREE_PATH + 2 * LANES + i]
        d3, d4 = f[FREE_PATH + 3 * LANES + i], f[FREE_PATH + 4 * LANES + i]
        word, w0, w1, w2, w3 = next_word(
            w[WORDS + i], w[WORDS + LANES + i], w[WORDS + 2 * LANES + i], w[WORDS + 3 * LANES + i]
        )
        w[WORDS + i] = w0
        w[WORDS + LANES + i] = w1
        w[WORDS + 2 * LANES + i] = w2
        w[WORDS + 3 * LANES + i] = w3
        tau = -log_unit(uniform(word))
        uz = f[UZ + i]
        m0 = f[M + i]
        m1 = m0 + uz * tau
        z0 = f[Z + i]
        z1 = d0 * m1 + d1 * max(m1 - b1, zero) + d2 * max(m1 - b2, zero) + d3 * max(m1 - b3, zero) + d4 * max(m1 - b4, zero)
        here = d0 + (d1 if m0 > b1 else zero) + (d2 if m0 > b2 else zero) + (d3 if m0 > b3 else zero) + (d4 if m0 > b4 else zero)
        # z1 - z0 cancels digits in level flight; tau / majorant is the same number unless the flight crosses a slab's
        # edge, and then they disagree by more than rounding
        local, sunk = tau * here, z1 - z0
        path = local if abs(sunk - uz * local) <= np.float32(1e-5) * z0 else sunk / uz
        f[M + i] = m1
        f[Z + i] = z1
        f[Z_START + i] = z0
        f[PATH + i] = path
        f[X + i] += f[UX + i] * path
        f[Y + i] += f[UY + i] * path
        w[BORDER + i] = (
            np.int32(1) if (min(z0, z1) < f[Z_SAFE_TOP + i]) | (max(z0, z1) > f[Z_SAFE_BOTTOM + i]) else np.int32(0)
        )


@block_kernel
def wrap(f, n, lx, ly):
    """Periodic sides: brings x and y of n lanes back into [0, lx) x [0, ly)."""
    inverse_x, inverse_y = np.float32(1.0) / lx, np.float32(1.0) / ly
    zero = lx - lx
    for i in range(n):
        x = f[X + i]
        f[X + i] = max(x - lx * np.floor(x * inverse_x), zero)
        y = f[Y + i]
        f[Y + i] = max(y - ly * np.floor(y * inverse_y), zero)


@block_kernel
def mark_sides(f, w, n, lx, ly):
    """Open or dielectric sides: a lane that flew out of the patch has met a border."""
    for i in range(n):
        outside = (f[X + i] < np.float32(0.0)) | (f[X + i] > lx) | (f[Y + i] < np.float32(0.0)) | (f[Y + i] > ly)
        w[BORDER + i] |= np.int32(1) if outside else np.int32(0)


@block_kernel
def locate(f, w, n, cells_per_mm, last_cell, bricks_y, planes):
    """Voxel column, as column of bricks and place in a brick, and coarse depth cell of n lanes, kept inside the
    volume."""
    cx, cy, cz = cells_per_mm[0], cells_per_mm[1], cells_per_mm[2]
    mx, my, mz = last_cell[0], last_cell[1], last_cell[2]
    zero, bits, inside = np.int32(0), np.int32(BRICK_BITS), np.int32(BRICK - 1)
    across, down = np.int32(bricks_y * planes), np.int32(planes)
    for i in range(n):
        ix = min(max(np.int32(f[X + i] * cx), zero), mx)
        iy = min(max(np.int32(f[Y + i] * cy), zero), my)
        w[BRICKS + i] = np.int32(np.int32(np.int32(ix >> bits) * across) + np.int32(np.int32(iy >> bits) * down))
        w[IN_BRICK + i] = np.int32(np.int32(np.int32(ix & inside) << bits) | np.int32(iy & inside))
        w[PLANE + i] = min(max(np.int32(f[Z + i] * cz), zero), mz)
