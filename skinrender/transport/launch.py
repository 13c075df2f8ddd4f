"""Launching: the next histories take the lanes of photons that have ended.

Histories arrive many at a time, in a block of their own, and wait there for lanes: emission vectorizes then. One by one a
history took 100 ns, of which emission 45 and most of the rest guesses that went wrong; under a relief 230.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import block_kernel, kernel
from skinrender.transport.emission import emit
from skinrender.transport.entrance import enter
from skinrender.transport.lanes import (
    EMPTY,
    FRESH,
    LANES,
    LASTING_FLOAT_ROWS,
    LASTING_INT_ROWS,
    LISTED,
    whole_groups,
)  # fmt: skip
from skinrender.transport.rng import seed_words
from skinrender.transport.tally import EMITTED, REFLECTED, REFLECTED_UNSCATTERED, SPECULAR

# Members of a walk's state
BAND_NEXT, HISTORY_NEXT = 0, 1
ARRIVED, LAUNCHED = 2, 3  # histories in the block of arrivals, and how many of these have left it


class Histories(NamedTuple):
    """The histories that a walk launches, one band after the other.

    key (B,) u8: of `rng.stream_key`; first, count (B,) i8: index of a band's first history, and how many; before (B,) i8:
    how many the bands before have; tiles_x, tiles_y: see `emission.stratum`; lamp, see `emission`; z_mean: depth of the mean
    plane; store_first: first scatterings of straight light are stored too.
    """

    key: np.ndarray
    first: np.ndarray
    count: np.ndarray
    before: np.ndarray
    tiles_x: int
    tiles_y: int
    lamp: tuple[float, ...]
    z_mean: float
    store_first: bool


@block_kernel
def seed(w, n, key, first):
    """Seeds the generators of n lanes with the histories `first` and on under `key`."""
    for i in range(n):
        w0, w1, w2, w3 = seed_words(key, first + i)
        w[i], w[LANES + i], w[2 * LANES + i], w[3 * LANES + i] = w0, w1, w2, w3


@kernel
def arrive(f, w, source, medium, relief, tally, state):
    """Lets the next histories enter the skin, as many of a band as there are lanes; lists those that did.

    There are none when no history is left. Light that never enters is tallied as specular.
    """
    borders = medium.borders
    state[ARRIVED], state[LAUNCHED] = 0, 0
    while state[ARRIVED] == 0 and state[BAND_NEXT] < source.count.size:
        band, index = state[BAND_NEXT], state[HISTORY_NEXT]
        n = min(source.count[band] - index, LANES)
        state[HISTORY_NEXT] += n
        if index + n == source.count[band]:
            state[BAND_NEXT], state[HISTORY_NEXT] = band + 1, 0
        whole = whole_groups(n)
        seed(w, whole, source.key[band], source.first[band] + index)
        emit(f, w, whole, index, source.count[band], source.tiles_x, source.tiles_y, source.lamp, borders.lx, borders.ly)
        state[ARRIVED] = enter(f, w, n, band, source.z_mean, medium, relief, source.store_first)
        specular = n - state[ARRIVED]
        tally[band, EMITTED] += n
        tally[band, REFLECTED] += specular
        tally[band, SPECULAR] += specular
        tally[band, REFLECTED_UNSCATTERED] += specular


@kernel
def relaunch(f, w, ended, arrivals, source, medium, relief, tally, state):
    """Launches the next histories in the lanes listed whose photons have ended; whether a lane is left empty.

    arrivals: the block, of the same type, in which histories wait.
    """
    waiting_f, waiting_w = arrivals
    for k in range(ended):
        i = np.uint64(w[LISTED + k])
        if state[LAUNCHED] == state[ARRIVED]:
            arrive(waiting_f, waiting_w, source, medium, relief, tally, state)
        if state[ARRIVED] == 0:
            w[np.uint64(FRESH) + i] = EMPTY
        else:
            copy_lane(waiting_f, waiting_w, np.uint64(waiting_w[LISTED + state[LAUNCHED]]), f, w, i)
            state[LAUNCHED] += 1
    return ended > 0 and state[ARRIVED] == 0


@kernel
def copy_lane(f, w, lane, to_f, to_w, to_lane):
    """Copies what stays with a photon from one lane to another.

    Indices are unsigned: numba's test for negative ones takes three times as long as the copying.
    """
    for row in range(np.uint64(LASTING_FLOAT_ROWS)):
        at = row * np.uint64(LANES)
        to_f[at + to_lane] = f[at + lane]
    for row in range(np.uint64(LASTING_INT_ROWS)):
        at = row * np.uint64(LANES)
        to_w[at + to_lane] = w[at + lane]


@kernel
def close_holes(f, w, n):
    """Moves the last live lanes into the empty ones; returns the number of lanes in flight."""
    i = np.int64(0)
    while i < n:
        if w[FRESH + i] == EMPTY:
            n -= 1
            copy_lane(f, w, np.uint64(n), f, w, np.uint64(i))
        else:
            i += 1
    return n
