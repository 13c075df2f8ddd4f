"""The photon walk of one band: blocks of lanes through the passes until every history has ended (paper, section 7.1).

    fly -> wrap or mark_sides -> meet_borders -> locate -> find_voxels -> gather -> collide -> count_events
    -> thin_out -> store -> relaunch

A dead lane is relaunched in place with the next history; when none is left, the last live lane moves into the hole.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import entry_kernel, inlined_kernel, kernel
from skinrender.transport.borders import INSIDE, LEFT_BOTTOM, LEFT_TOP, PERIODIC, ROUGH, cross, enter_surface, place
from skinrender.transport.emission import emit, tile_position
from skinrender.transport.gather import find_voxels, gather
from skinrender.transport.lanes import (
    ARRIVED,
    BORDER,
    EMPTY,
    ENDED,
    EVENT,
    FLOAT_ROWS,
    FRESH,
    INT_ROWS,
    LANES,
    LISTED,
    SHOWN,
    STRAIGHT,
    UNSCATTERED,
    UX,
    UY,
    UZ,
    X,
    Y,
    Z,
)
from skinrender.transport.move import fly, locate, mark_sides, wrap
from skinrender.transport.relief import clear_by_bulge, clear_by_depth, look_around
from skinrender.transport.rng import draw, seed_words
from skinrender.transport.streaming import stream
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

_PASSES = 1 << 20  # after which `walk` returns, so that whoever called it can stop
# The vectorized passes run over whole groups of lanes (4 vectors of 16 floats): the scalar rest of such a loop rounds
# otherwise, and a history would depend on how many others are in flight.
_GROUP = 64


@inlined_kernel
def launch(f, w, i, source, borders, majorant, relief, light, tally, cursor):
    """Starts the next history that enters the skin in lane i; False when none is left.

    cursor[0] counts the histories used up. Light that never enters is tallied as specular.
    """
    key, first, count, tiles_x, tiles_y, z_mean, store_first = source
    while cursor[0] < count:
        index = cursor[0]
        cursor[0] += 1
        w0, w1, w2, w3 = seed_words(key, first + index)
        w[i], w[LANES + i], w[2 * LANES + i], w[3 * LANES + i] = w0, w1, w2, w3
        u, v = tile_position(index, count, tiles_x, tiles_y, draw(w, i, LANES), draw(w, i, LANES))
        x, y, ux, uy, uz = emit(light, borders.lx, borders.ly, z_mean, u, v, draw(w, i, LANES), draw(w, i, LANES))
        tally[EMITTED] += 1
        entered, bounces, x, y, z, ux, uy, uz = enter_surface(
            w, i, borders, relief, x, y, 0.0, ux, uy, uz, np.bool_(False)
        )
        if not entered:
            tally[REFLECTED] += 1
            tally[SPECULAR] += 1
            tally[REFLECTED_UNSCATTERED] += 1
            continue
        straight = STRAIGHT if bounces == 0 and not store_first else 0
        w[FRESH + i] = straight | UNSCATTERED
        place(f, w, i, borders, majorant, relief, np.int64(0), x, y, z, ux, uy, uz, int(borders.table[0, ROUGH]), 1.0)
        return True
    return False


@kernel
def leave(f, w, i, status, tally, exits):
    """Tallies a photon that left the volume; `exits` (or None) collects x, y, ux, uy, uz, scattered of the upward
    ones."""
    unscattered = (w[FRESH + i] & UNSCATTERED) != 0
    if status == LEFT_TOP:
        if exits is not None:
            k = tally[REFLECTED] - tally[SPECULAR]
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
def kept(w, i, z, z_top, keep):
    """Roulette on storage: whether a photon stored at z is kept.

    keep[0] = depth bins per mm below z_top, then the probability of each bin, the last for all that is deeper. z is
    rounded as it is stored, so that its bin can be found again from the map.
    """
    below = np.float64(np.float32(z)) - z_top
    probability = keep[1 + max(0, min(np.int64(below * keep[0]), keep.size - 2))]
    return probability >= 1.0 or draw(w, i, LANES) < probability


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
    way = tallies.shape[1]
    counts = tallies.reshape(tallies.size)
    for i in range(n):
        counts[np.uint64((i & (WAYS - 1)) * way) + np.uint64(w[EVENT + i])] += 1


@kernel
def thin_out(f, w, n, keep, z_top):
    """Roulette on storage: clears SHOWN of the photons that are not kept."""
    for i in range(n):
        if w[SHOWN + i] != 0:
            w[SHOWN + i] = np.int32(kept(w, i, f[Z + i] + z_top, z_top, keep))


@kernel
def store(f, w, n, position, direction, stored, z_top):
    """Writes the lanes with SHOWN set as photons number `stored` and on of the map; returns the number of the next.

    A lane that is not shown is written too, and overwritten by the next one: no branch to guess.
    """
    k = np.uint64(stored)
    for i in range(n):
        stream(position, np.uint64(3) * k, np.float32(f[X + i]))
        stream(position, np.uint64(3) * k + np.uint64(1), np.float32(f[Y + i]))
        stream(position, np.uint64(3) * k + np.uint64(2), np.float32(f[Z + i] + z_top))
        stream(direction, k, w[ARRIVED + i])
        k += np.uint64(w[SHOWN + i])
    return np.int64(k)


@kernel
def relaunch(f, w, ended, source, medium, relief, light, tally, cursor):
    """Launches the next histories in the lanes listed whose photons have ended; whether a lane is left empty."""
    holes = False
    for k in range(ended):
        i = np.int64(np.uint32(w[LISTED + k]))
        if not launch(f, w, i, source, medium.borders, medium.majorant, relief, light, tally, cursor):
            w[FRESH + i] = EMPTY
            holes = True
    return holes


@kernel
def list_lanes(w, n, flag):
    """Lists in w[LISTED:] those of n lanes whose word at `flag` is set, few as a rule; returns their number.

    Without a branch, and indices are unsigned: a look at 16 lanes together first, most of them empty, took twice as long.
    """
    listed = np.uint64(LISTED)
    for i in range(n):
        w[listed] = i
        listed += np.uint64(w[i + flag] != 0)
    return listed - np.uint64(LISTED)


@kernel
def meet_borders(f, w, marked, medium, relief, tally, exits):
    """Follows the few flights that may have met a border; the lane of a photon that left is free.

    It is not used again before `relaunch`: this step's collision would take numbers of the new history.
    """
    borders, majorant = medium.borders, medium.majorant
    for k in range(marked):
        i = np.int64(np.uint32(w[LISTED + k]))
        status = cross(f, w, i, borders, majorant, relief)
        if status != INSIDE:
            leave(f, w, i, status, tally, exits)
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
def walk(f, w, source, light, medium, relief, keep, position, direction, tallies, exits, state):
    """Walks the histories of `source`; returns early, to be called again, after a while and when the output is filling.

    Parameters
    ----------
    f, w : buffers of `lanes.new_block`.
    source : (key, first index, count, tiles x, tiles y, depth of the mean plane, store first scatterings).
    light : parameters of a lamp, see `emission`.
    medium, relief : `medium.Medium` of the band; `borders.Relief` or None.
    keep : roulette on storage, see `kept`, or None.
    position, direction : (3 n,) float32 and (n,) int32 to fill, n > LANES, or None: nothing is stored.
    tallies : (WAYS, columns) int64, added to: copies, to be summed.
    exits : (histories, 6) float32 or None, see `leave`.
    state : int64 [histories used up, lanes in flight (0: finished), photons stored, flights since a history ended].
    """
    cursor = state[0:1]
    tally = tallies[0]
    passes = 0
    n = state[1]
    stored = state[2]
    room = np.int64(0x7FFFFFFFFFFFFFFF)
    if position is not None:
        room = direction.shape[0] - LANES
    if cursor[0] == 0:
        for i in range(LANES):
            w[LISTED + i] = i
        relaunch(f, w, np.uint64(LANES), source, medium, relief, light, tally, cursor)
        n = close_holes(f, w, np.int64(LANES))
    while n > 0 and stored <= room and passes < _PASSES:
        passes += 1
        launched = cursor[0]
        whole = (n + _GROUP - 1) // _GROUP * _GROUP
        fly(f, w, whole, medium.slabs)
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
        meet_borders(f, w, marked, medium, relief, tally, exits)
        locate(f, w, whole, medium.cells_per_mm, medium.last_cell, medium.grid.bricks_y, medium.grid.planes)
        find_voxels(f, w, n, medium.grid)
        gather(f, w, n, medium.grid, medium.plane_row, medium.rows, medium.rows_as_float)
        collide(f, w, whole, PER_LAYER + medium.layers)
        count_events(w, n, tallies)
        if position is not None:
            if keep is not None:
                thin_out(f, w, n, keep, medium.z_top)
            stored = store(f, w, n, position, direction, stored, medium.z_top)
        ended = list_lanes(w, n, np.uint32(ENDED))
        holes = relaunch(f, w, ended, source, medium, relief, light, tally, cursor)
        state[3] = 0 if holes or cursor[0] > launched else state[3] + whole
        if holes:
            n = close_holes(f, w, n)
    state[1] = n
    state[2] = stored
