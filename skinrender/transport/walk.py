"""The photon walk: a block of lanes through the passes until every history has ended (paper, section 7.1).

    fly -> wrap or mark_sides -> meet_borders -> locate -> find_voxels -> gather -> collide -> count_events
    -> roll, thin_out or list_lanes -> store -> relaunch

A dead lane is relaunched in place with the next history, of the next band when one's have all begun: each lane holds
what differs between bands. With a block for each band the last histories of each, ten times as long as others, flew in
a block all but empty: rounds of 190 histories in 81 bands took two to three times as long.
When no history is left, the last live lane moves into the hole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinrender.transport import entry_kernel, inlined_kernel, kernel
from skinrender.transport.borders import INSIDE, LEFT_BOTTOM, LEFT_TOP, PERIODIC, ROUGH, cross, enter_surface, place
from skinrender.transport.caches import stream
from skinrender.transport.emission import emit, tile_position
from skinrender.transport.gather import find_voxels, gather
from skinrender.transport.lanes import (
    ARRIVED,
    BAND,
    BORDER,
    DEPTH_BIN,
    EMPTY,
    ENDED,
    EVENT,
    FLOAT_ROWS,
    FRESH,
    INT_ROWS,
    LANES,
    LISTED,
    ROLLED,
    SHOWN,
    SLAB_DEPTH,
    SLABS,
    STRAIGHT,
    UNSCATTERED,
    UX,
    UY,
    UZ,
    WORDS,
    X,
    Y,
    Z,
)
from skinrender.transport.move import fly, locate, mark_sides, wrap
from skinrender.transport.relief import clear_by_bulge, clear_by_depth, look_around
from skinrender.transport.rng import draw, next_word, seed_words
from skinrender.transport.tally import (
    EMITTED,
    PER_LAYER,
    REFLECTED,
    REFLECTED_UNSCATTERED,
    SIDES,
    SPECULAR,
    TRANSMITTED,
    TRANSMITTED_UNSCATTERED,
    WAYS,
)
from skinrender.transport.turn import collide

# Members of a walk's state
IN_FLIGHT = 2  # lanes; 0: begins, or has ended
STORED = 3  # photons
IDLE = 4  # flights since a history ended

_PASSES = 1 << 20  # after which `walk` returns, so that whoever called it can stop
# The vectorized passes run over whole groups of lanes (4 vectors of 16 floats): the scalar rest of such a loop rounds
# otherwise, and a history would depend on how many others are in flight.
_GROUP = 64


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
def leave(f, w, i, status, tally, exits, before):
    """Tallies a photon that left the volume; `exits` (or None) collects x, y, ux, uy, uz, scattered of the upward
    ones, those of a band from row before[band] on."""
    band = np.uint64(w[BAND + i])
    tally = tally[band]
    unscattered = (w[FRESH + i] & UNSCATTERED) != 0
    if status == LEFT_TOP:
        if exits is not None:
            k = before[band] + tally[REFLECTED] - tally[SPECULAR]
            exits[k, 0], exits[k, 1] = f[X + i], f[Y + i]
            exits[k, 2], exits[k, 3], exits[k, 4] = f[UX + i], f[UY + i], f[UZ + i]
            exits[k, 5] = 0.0 if unscattered else 1.0
        tally[REFLECTED] += 1
        if unscattered:
            tally[REFLECTED_UNSCATTERED] += 1
    elif status == LEFT_BOTTOM:
        tally[TRANSMITTED] += 1
        if unscattered:
            tally[TRANSMITTED_UNSCATTERED] += 1
    else:
        tally[SIDES] += 1


@kernel
def move_lane(f, w, source, target):
    """Copies the state of one lane onto another."""
    for row in range(FLOAT_ROWS):
        f[row * LANES + target] = f[row * LANES + source]
    for row in range(INT_ROWS):
        w[row * LANES + target] = w[row * LANES + source]


@kernel
def count_events(w, n, tallies):
    """Tallies what happened to n lanes.

    In turn in each of the `tally.WAYS` copies: a count that waits for the one before takes 2 ns.
    """
    way = tallies.shape[1] * tallies.shape[2]
    counts = tallies.reshape(tallies.size)
    for i in range(n):
        counts[np.uint64((i & (WAYS - 1)) * way) + np.uint64(w[EVENT + i])] += 1


@kernel
def roll(f, w, n, keep, z_top):
    """Draws the word by which roulette on storage decides, for n lanes, and finds their bins in `keep`.

    keep: depth bins per mm below z_top, and of each band and bin (B, D) the largest word that keeps, the last bin for
    all that is deeper. z is rounded as it is stored, so that its bin can be found again from the map.
    """
    bins_per_mm, bins = keep[0], np.int32(keep[1].shape[1])
    zero, last = np.int32(0), np.int32(bins - np.int32(1))
    for i in range(n):
        below = np.float64(np.float32(f[Z + i] + z_top)) - z_top
        bin = min(max(np.int32(below * bins_per_mm), zero), last)
        w[DEPTH_BIN + i] = np.int32(bin + np.int32(bins * w[BAND + i]))
        w[ROLLED + i], w0, w1, w2, w3 = next_word(
            w[WORDS + i], w[WORDS + LANES + i], w[WORDS + 2 * LANES + i], w[WORDS + 3 * LANES + i]
        )
        w[WORDS + i] = w0
        w[WORDS + LANES + i] = w1
        w[WORDS + 2 * LANES + i] = w2
        w[WORDS + 3 * LANES + i] = w3


@kernel
def thin_out(w, n, keep):
    """Roulette on storage: lists those of n lanes with SHOWN set that are kept, see `roll`; returns their number.

    Without a branch, as `list_lanes`: who is kept can't be guessed.
    """
    largest, listed = keep[1].reshape(keep[1].size), np.uint64(LISTED)
    for i in range(n):
        keeps = w[ROLLED + i] <= largest[np.uint64(w[DEPTH_BIN + i])]
        w[listed] = i
        listed += np.uint64(keeps & (w[SHOWN + i] != 0))
    return listed - np.uint64(LISTED)


@kernel
def store(f, w, shown, photons, stored, z_top):
    """Writes the lanes listed as photons number `stored` and on; returns the number of the next."""
    position, direction, band = photons
    at = np.uint64(stored)
    for k in range(shown):
        i = np.int64(np.uint32(w[LISTED + k]))
        stream(position, np.uint64(3) * at, np.float32(f[X + i]))
        stream(position, np.uint64(3) * at + np.uint64(1), np.float32(f[Y + i]))
        stream(position, np.uint64(3) * at + np.uint64(2), np.float32(f[Z + i] + z_top))
        stream(direction, at, w[ARRIVED + i])
        band[at] = w[BAND + i]
        at += np.uint64(1)
    return np.int64(at)


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
def list_lanes(w, n, flag):
    """Lists in w[LISTED:] those of n lanes whose word at `flag` is set; returns their number.

    Without a branch, and indices are unsigned: a look at 16 lanes together first, most of them empty, took twice as long.
    """
    listed = np.uint64(LISTED)
    for i in range(n):
        w[listed] = i
        listed += np.uint64(w[i + flag] != 0)
    return listed - np.uint64(LISTED)


@kernel
def meet_borders(f, w, marked, medium, relief, tally, exits, before):
    """Follows the few flights that may have met a border; the lane of a photon that left is free.

    It is not used again before `relaunch`: this step's collision would take numbers of the new history.
    """
    borders, majorant = medium.borders, medium.majorant
    for k in range(marked):
        i = np.int64(np.uint32(w[LISTED + k]))
        status = cross(f, w, i, borders, majorant, relief)
        if status != INSIDE:
            leave(f, w, i, status, tally, exits, before)
            w[FRESH + i] = EMPTY


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


@entry_kernel
def walk(f, w, source, light, medium, relief, keep, photons, tallies, exits, state):
    """Walks the histories of `source`; returns early, to be called again, after a while and when the output is filling.

    Parameters
    ----------
    f, w : buffers of `lanes.new_block`.
    source : the `Histories`.
    light : parameters of a lamp, see `emission`.
    medium, relief : `medium.Medium`; `relief.Relief` or None.
    keep : roulette on storage, see `roll`, or None.
    photons : position (3 n,) f4, direction (n,) i4 and band (n,) u1 to fill, n > LANES, or None: nothing is stored.
    tallies : (WAYS, B, columns) int64, added to: copies, to be summed.
    exits : (histories, 6) float32 or None, see `leave`.
    state : (5,) int64: band and history in it that are next, then as IN_FLIGHT, STORED and IDLE say.
    """
    cursor = state[:2]
    tally = tallies[0]
    passes = 0
    n = state[IN_FLIGHT]
    stored = state[STORED]
    room = np.int64(0x7FFFFFFFFFFFFFFF)
    if photons is not None:
        room = photons[2].size - LANES
    if n == 0:
        for i in range(LANES):
            w[LISTED + i] = i
        relaunch(f, w, np.uint64(LANES), source, medium, relief, light, tally, cursor)
        n = close_holes(f, w, np.int64(LANES))
    while n > 0 and stored <= room and passes < _PASSES:
        passes += 1
        band, index = cursor[0], cursor[1]
        whole = (n + _GROUP - 1) // _GROUP * _GROUP
        fly(f, w, whole)
        if medium.borders.sides == PERIODIC:
            wrap(f, whole, medium.period[0], medium.period[1])
        else:
            mark_sides(f, w, whole, medium.period[0], medium.period[1])
        marked = list_lanes(w, n, np.uint32(BORDER))
        if relief is not None:
            if medium.borders.sides == PERIODIC:
                look_around(f, w, whole, medium.period[0], medium.period[1], relief.tiles_per_mm, relief.last_tile)
                marked = clear_by_depth(f, w, marked, medium.borders, relief)
                marked = clear_by_bulge(f, w, marked, medium.borders, relief)
        meet_borders(f, w, marked, medium, relief, tally, exits, source.before)
        locate(f, w, whole, medium.cells_per_mm, medium.last_cell, medium.grid.bricks_y, medium.grid.planes)
        find_voxels(f, w, n, medium.grid)
        gather(f, w, n, medium.grid, medium.plane_row, medium.rows, medium.rows_as_float)
        collide(f, w, whole, PER_LAYER + medium.layers, tallies.shape[2])
        count_events(w, n, tallies)
        if photons is not None:
            if keep is not None:
                roll(f, w, n, keep, medium.z_top)
                shown = thin_out(w, n, keep)
            else:
                shown = list_lanes(w, n, np.uint32(SHOWN))
            stored = store(f, w, shown, photons, stored, medium.z_top)
        ended = list_lanes(w, n, np.uint32(ENDED))
        holes = relaunch(f, w, ended, source, medium, relief, light, tally, cursor)
        state[IDLE] = 0 if holes or cursor[1] != index or cursor[0] != band else state[IDLE] + whole
        if holes:
            n = close_holes(f, w, n)
    state[IN_FLIGHT] = n
    state[STORED] = stored
