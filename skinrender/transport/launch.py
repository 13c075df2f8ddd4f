"""Launching: the next histories take the lanes of photons that have ended."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import inlined_kernel, kernel
from skinrender.transport.borders import enter_surface, place
from skinrender.transport.emission import emit, tile_position
from skinrender.transport.lanes import (
    BAND,
    EMPTY,
    FLOAT_ROWS,
    FRESH,
    INT_ROWS,
    LANES,
    LISTED,
    SLAB_DEPTH,
    SLABS,
    STRAIGHT,
    UNSCATTERED,
)
from skinrender.transport.relief import ROUGH
from skinrender.transport.rng import draw, seed_words
from skinrender.transport.tally import EMITTED, REFLECTED, REFLECTED_UNSCATTERED, SPECULAR


class Histories(NamedTuple):
    """The histories that a walk launches, one band after the other.

    key (B,) u8: of `rng.stream_key`; first, count (B,) i8: index of a band's first history, and how many; before (B,) i8:
    how many the bands before have; tiles_x, tiles_y: see `emission.tile_position`; z_mean: depth of the mean plane;
    store_first: first scatterings of straight light are stored too.
    """

    key: np.ndarray
    first: np.ndarray
    count: np.ndarray
    before: np.ndarray
    tiles_x: int
    tiles_y: int
    z_mean: float
    store_first: bool


@inlined_kernel
def launch(f, w, i, source, medium, relief, light, tally, cursor):
    """Starts the next history that enters the skin in lane i; False when none is left.

    cursor: band, and histories of it used up. Light that never enters is tallied as specular.
    """
    borders = medium.borders
    while cursor[0] < source.count.size:
        band, index = cursor[0], cursor[1]
        if index == source.count[band]:
            cursor[0], cursor[1] = band + 1, 0
            continue
        cursor[1] = index + 1
        w0, w1, w2, w3 = seed_words(source.key[band], source.first[band] + index)
        w[i], w[LANES + i], w[2 * LANES + i], w[3 * LANES + i] = w0, w1, w2, w3
        w[BAND + i] = band
        u, v = tile_position(
            index, source.count[band], source.tiles_x, source.tiles_y, draw(w, i, LANES), draw(w, i, LANES)
        )
        x, y, ux, uy, uz = emit(
            light, borders.lx, borders.ly, source.z_mean, u, v, draw(w, i, LANES), draw(w, i, LANES)
        )
        tally[band, EMITTED] += 1
        entered, bounces, x, y, z, ux, uy, uz = enter_surface(
            w, i, borders, relief, x, y, 0.0, ux, uy, uz, np.bool_(False)
        )
        if not entered:
            tally[band, REFLECTED] += 1
            tally[band, SPECULAR] += 1
            tally[band, REFLECTED_UNSCATTERED] += 1
            continue
        straight = STRAIGHT if bounces == 0 and not source.store_first else 0
        w[FRESH + i] = straight | UNSCATTERED
        for k in range(2 * SLABS - 1):
            f[SLAB_DEPTH + k * LANES + i] = medium.slabs[band, k]
        rough = int(borders.table[0, ROUGH])
        place(f, w, i, borders, medium.majorant, relief, np.int64(0), x, y, z, ux, uy, uz, rough, 1.0)
        return True
    return False


@kernel
def relaunch(f, w, ended, source, medium, relief, light, tally, cursor):
    """Launches the next histories in the lanes listed whose photons have ended; whether a lane is left empty."""
    holes = False
    for k in range(ended):
        i = np.int64(np.uint32(w[LISTED + k]))
        if not launch(f, w, i, source, medium, relief, light, tally, cursor):
            w[FRESH + i] = EMPTY
            holes = True
    return holes


@kernel
def move_lane(f, w, source, target):
    """Copies the state of one lane onto another."""
    for row in range(FLOAT_ROWS):
        f[row * LANES + target] = f[row * LANES + source]
    for row in range(INT_ROWS):
        w[row * LANES + target] = w[row * LANES + source]


@kernel
def close_holes(f, w, n):
    """Moves the last live lanes into the empty ones; returns the number of lanes in flight."""
    i = np.int64(0)
    while i < n:
        if w[FRESH + i] == EMPTY:
            n -= 1
            move_lane(f, w, n, i)
        else:
            i += 1
    return n
