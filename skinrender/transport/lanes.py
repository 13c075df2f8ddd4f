"""The block of photons in flight: one float and one int32 buffer, structure of arrays at constant offsets.

A block is walked in passes over all its lanes (see `walk`). One buffer a type at
constant offsets, not one array a quantity: with many array arguments LLVM can't rule out that they overlap and gives up
vectorizing. The float buffer is float32, or float64 for stiff stacks (`medium.block_type`).
"""

from __future__ import annotations

import numpy as np

LANES = 256  # from 128 to 1024 none was better, see docs/walk.md

# float rows
X, Y, Z = 0 * LANES, 1 * LANES, 2 * LANES  # position (mm), z from the top of the volume downwards
M = 3 * LANES  # majorant optical depth from the top of the volume
UX, UY, UZ = 4 * LANES, 5 * LANES, 6 * LANES  # direction of flight
PATH = 7 * LANES  # length of the flight just made (mm)
Z_START = 8 * LANES  # z at the start of that flight
Z_SAFE_TOP, Z_SAFE_BOTTOM = 9 * LANES, 10 * LANES  # between these no border can be met
G = 11 * LANES  # anisotropy at the collision
SLABS = 5  # of the majorant, at most; the next rows hold those of the lane's band, see `medium.flight_constants`
SLAB_DEPTH, FREE_PATH = 12 * LANES, (11 + SLABS) * LANES
FLOAT_ROWS = 11 + 2 * SLABS

# int32 rows; the first four are the generator's state words
WORDS = 0
BRICKS, IN_BRICK = 4 * LANES, 5 * LANES  # first brick of the voxel's column, and the column in it (see `gather`)
PLANE = 6 * LANES  # coarse depth cell, then voxel plane
BORDER = 7 * LANES  # 1: the flight may have met a border; after `cross`, 1: it ended on one
SCATTER_BELOW, ABSORB_ABOVE = 8 * LANES, 9 * LANES  # thresholds of the collision's word
EVENT = 10 * LANES  # place in the tally, columns by bands, that counts what happened
ARRIVED = 11 * LANES  # packed direction of flight before the collision
FRESH = 12 * LANES  # bit 0: path is one straight refracted passage so far; bit 1: never scattered
REGION = 13 * LANES  # which layer between two borders with an index step
TISSUE = 14 * LANES  # tissue layer at the collision
LISTED = 15 * LANES  # not a lane's: list of some lanes
OVER = 16 * LANES  # row of `relief.Relief.around`
SHOWN = 17 * LANES  # 1: scattered, and belongs into the map
ENDED = 18 * LANES  # 1: the history has ended
VOXEL = 19 * LANES  # place of the voxel in `gather.Grid.palette`
BAND = 20 * LANES  # wavelength band
ROLLED = 21 * LANES  # the word by which roulette on storage decides
DEPTH_BIN = 22 * LANES  # place in its table, bins by bands
INT_ROWS = 23

STRAIGHT, UNSCATTERED = 1, 2
EMPTY = -1  # value of FRESH when a photon has left and no other is in its lane


def new_block(real: type) -> tuple[np.ndarray, np.ndarray]:
    """Empty buffers of a block: floats of type `real`, int32 words."""
    return np.zeros(FLOAT_ROWS * LANES, dtype=real), np.zeros(INT_ROWS * LANES, dtype=np.int32)
