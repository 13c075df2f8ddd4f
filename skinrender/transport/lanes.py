"""The block of photons in flight: one float and one int32 buffer, structure of arrays at constant offsets.

A block is walked in passes over all its lanes (see `walk`). One buffer a type at
constant offsets, not one array a quantity: with many array arguments LLVM can't rule out that they overlap and gives up
vectorizing. The float buffer is float32, or float64 for stiff stacks (`medium.block_type`).
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.vectors import SQUEEZED, append_set

LANES = 256  # from 128 to 1024 none was better, see docs/walk.md
# The vectorized passes run over whole groups of lanes (4 vectors of 16 floats): the scalar rest of such a loop rounds
# otherwise, and a history would depend on how many others are in flight. LANES is a multiple of it, and it of what `vectors`
# takes at once.
GROUP = 64
CACHE_LINE = 64  # bytes

# Float rows that stay with a photon from flight to flight
X, Y, Z = 0 * LANES, 1 * LANES, 2 * LANES  # position (mm), z from the top of the volume downwards
M = 3 * LANES  # majorant optical depth from the top of the volume
UX, UY, UZ = 4 * LANES, 5 * LANES, 6 * LANES  # direction of flight
Z_SAFE_TOP, Z_SAFE_BOTTOM = 7 * LANES, 8 * LANES  # between these no border can be met
SLABS = 5  # of the majorant, at most; the next rows hold those of the lane's band, see `medium.flight_constants`
SLAB_DEPTH, FREE_PATH = 9 * LANES, (8 + SLABS) * LANES
LASTING_FLOAT_ROWS = 8 + 2 * SLABS
# Those that one pass tells a later one; where histories arrive, `entrance` uses some of them otherwise
PATH = LASTING_FLOAT_ROWS * LANES  # length of the flight just made (mm)
Z_START = (LASTING_FLOAT_ROWS + 1) * LANES  # z at the start of that flight
EDGE = (LASTING_FLOAT_ROWS + 2) * LANES  # lower edge of a voxel plane (mm)
G = (LASTING_FLOAT_ROWS + 3) * LANES  # anisotropy at the collision
FLOAT_ROWS = LASTING_FLOAT_ROWS + 4

# Int32 rows that stay with a photon; the first four are the generator's state words
WORDS = 0
BAND = 4 * LANES  # wavelength band
REGION = 5 * LANES  # which layer between two borders with an index step
FRESH = 6 * LANES  # bit 0: path is one straight refracted passage so far; bit 1: never scattered
LASTING_INT_ROWS = 7
# Those that one pass tells a later one; where histories arrive, `entrance` uses some of them otherwise
BORDER = 7 * LANES  # 1: the flight may have met a border; after `cross`, 1: it ended on one
OVER = 8 * LANES  # row of `relief.Relief.around`
BRICKS, IN_BRICK = 9 * LANES, 10 * LANES  # first brick of the voxel's column, then its brick; and the column in it
PLANE = 11 * LANES  # coarse depth cell, then voxel plane
BRICK = 12 * LANES  # of `gather.Grid.brick`
VOXEL = 13 * LANES  # place of the voxel in `gather.Grid.palette`
BAND_PLANE = 14 * LANES  # voxel plane among those of all bands, then its first row in `Medium.rows`
ENTRY = 15 * LANES  # palette entry, then place of its row
SCATTER_BELOW, ABSORB_ABOVE = 16 * LANES, 17 * LANES  # thresholds of the collision's word
TISSUE = 18 * LANES  # tissue layer at the collision
EVENT = 19 * LANES  # place in the tally, columns by bands, that counts what happened
INCOMING = 20 * LANES  # packed direction of flight before the collision
SHOWN = 21 * LANES  # 1: scattered, and belongs into the map, then also whether roulette keeps it
ENDED = 22 * LANES  # 1: the history has ended
ROLLED = 23 * LANES  # the word by which roulette on storage decides
DEPTH_BIN = 24 * LANES  # place in its table, bins by bands
KEPT_BELOW = 25 * LANES  # largest word that keeps, from there
LISTED = 26 * LANES  # not a lane's: list of some lanes; `append_set` writes whole vectors, up to the end of this last row
INT_ROWS = 27

STRAIGHT, UNSCATTERED = 1, 2
EMPTY = -1  # value of FRESH when a photon has left and no other is in its lane


@kernel
def look_up(table, w, at, out, to, n):
    """out[to:] = table[w[at:]] of n lanes.

    Indices are unsigned: numba's test for negative ones costs as much as the look-up.
    """
    at, to = np.uint64(at), np.uint64(to)
    for i in range(np.uint64(n)):
        out[to + i] = table[np.uint64(w[at + i])]


@kernel
def list_lanes(w, n, flag):
    """Lists in w[LISTED:] those of n lanes whose word at `flag` is set; returns their number.

    A vector of lanes at once: 0.1 ns a lane where the processor can squeeze one (AVX-512), and 0.3 word by word without a
    branch, which is what others do.
    """
    listed = np.uint64(LISTED)
    for i in range(0, n, SQUEEZED):
        listed += append_set(w, np.uint64(flag + i), i, n, listed)
    return listed - np.uint64(LISTED)


@kernel
def whole_groups(n):
    """So many lanes that all groups with one of the first n lanes are whole."""
    return (n + GROUP - 1) // GROUP * GROUP


def new_block(real: type) -> tuple[np.ndarray, np.ndarray]:
    """Zeroed buffers of a block: floats of type `real`, int32 words; vectors of lanes don't lie across cache lines."""
    return _aligned(FLOAT_ROWS * LANES, real), _aligned(INT_ROWS * LANES, np.int32)


def _aligned(size: int, kind: type) -> np.ndarray:
    """Zeros that begin with a cache line."""
    wide = np.zeros(size + CACHE_LINE // np.dtype(kind).itemsize, kind)
    first = -wide.ctypes.data % CACHE_LINE // wide.itemsize
    return wide[first : first + size]
