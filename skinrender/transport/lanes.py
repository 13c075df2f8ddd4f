"""The block of photons in flight: one float and one int32 buffer, structure of arrays at constant offsets.

A block is walked in passes over all its lanes (`move`, `cross`, `gather`, `turn`, `emit`). One buffer a type at constant
offsets, not one array a quantity: with many array arguments LLVM can't rule out that they overlap and gives up
vectorizing. The float buffer is float32, or float64 for stiff stacks (`Medium.real`).
"""

from __future__ import annotations

import numpy as np

LANES = 512  # 256 to 2048 lanes run equally fast; the two buffers of 512 stay in a 64 KiB corner of the cache

# float rows
X, Y, Z = 0 * LANES, 1 * LANES, 2 * LANES  # position (mm), z from the top of the volume downwards
M = 3 * LANES  # majorant optical depth from the top of the volume
UX, UY, UZ = 4 * LANES, 5 * LANES, 6 * LANES  # direction of flight
PATH = 7 * LANES  # length of the flight just made (mm)
Z_START = 8 * LANES  # z at the start of that flight
Z_SAFE_TOP, Z_SAFE_BOTTOM = 9 * LANES, 10 * LANES  # between these no border can be met
G = 11 * LANES  # anisotropy at the collision
FLOAT_ROWS = 12

# int32 rows; the first four are the generator's state words
WORDS = 0
BRICK_XY, IN_BRICK = 4 * LANES, 5 * LANES  # brick of the voxel's column, and the column in it (see `gather`)
IZ = 6 * LANES  # coarse depth cell
BORDER = 7 * LANES  # 1: the flight may have met a border; after `cross`, 1: it ended on one
SCATTER_BELOW, ABSORB_ABOVE = 8 * LANES, 9 * LANES  # thresholds of the collision's word
EVENT = 10 * LANES  # what happened at the collision
ARRIVED = 11 * LANES  # packed direction of flight before the collision
FRESH = 12 * LANES  # bit 0: path is one straight refracted passage so far; bit 1: never scattered
REGION = 13 * LANES  # which layer between two borders with an index step
TISSUE = 14 * LANES  # tissue layer at the collision
MARKED = 15 * LANES  # not a lane's: list of the lanes with BORDER set
OVER = 16 * LANES  # row of `relief.Relief.around`
INT_ROWS = 17

NULL, SCATTERED, ABSORBED = 0, 1, 2
STRAIGHT, UNSCATTERED = 1, 2


def new_block(real: type) -> tuple[np.ndarray, np.ndarray]:
    """Empty buffers of a block: floats of type `real`, int32 words."""
    return np.zeros(FLOAT_ROWS * LANES, dtype=real), np.zeros(INT_ROWS * LANES, dtype=np.int32)
