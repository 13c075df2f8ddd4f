"""The photon walk of one band: blocks of lanes through the passes until every history has ended (paper, section 7.1).

    fly -> wrap -> meet_borders -> locate -> gather -> collide -> settle

A dead lane is relaunched in place with the next history; when none is left, the last live lane moves into the hole.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.borders import INSIDE, LEFT_BOTTOM, LEFT_TOP, PERIODIC, ROUGH, cross, enter_surface, place
from skinrender.transport.emission import emit, tile_position
from skinrender.transport.gather import gather
from skinrender.transport.lanes import (
    ABSORBED,
    ARRIVED,
    BORDER,
    EVENT,
    FLOAT_ROWS,
    FRESH,
    INT_ROWS,
    LANES,
    MARKED,
    SCATTERED,
    STRAIGHT,
    TISSUE,
    UNSCATTERED,
    UX,
    UY,
    UZ,
    X,
    Y,
    Z,
)
from skinrender.transport.move import fly, locate, mark_sides, wrap
from skinrender.transport.relief import clear_of_relief, look_around
from skinrender.transport.rng import draw, seed_words
from skinrender.transport.tally import (
    BORDER_HITS,
    COLLISIONS_NULL,
    EMITTED,
    PER_LAYER,
    REFLECTED,
    REFLECTED_UNSCATTERED,
    SIDES,
    SPECULAR,
    TRANSMITTED,
    TRANSMITTED_UNSCATTERED,
)
from skinrender.transport.turn import collide

EMPTY = -1  # value of a lane's FRESH when its photon has left and no other is in it
_PASSES = 1 << 20  # after which `walk` returns, so that whoever called it can stop
# The vectorized passes run over whole groups of lanes (4 vectors of 16 floats): the scalar rest of such a loop rounds
# otherwise, and a history would depend on how many others are in flight.
_GROUP = 64


@kernel
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
            w, i, borders, relief, x, y, 0.0, ux, uy, uz, False
        )
        if not entered:
            tally[REFLECTED] += 1
            tally[SPECULAR] += 1
            tally[REFLECTED_UNSCATTERED] += 1
            continue
        straight = STRAIGHT if bounces == 0 and not store_first else 0
        w[FRESH + i] = straight | UNSCATTERED
        place(f, w, i, borders, majorant, relief, 0, x, y, z, ux, uy, uz, int(borders.table[0, ROUGH]), 1.0)
        return True
    return False


@kernel
def leave(f, w, i, status, tally, exits):
    """Tallies a photon that left the volume; `exits` (or None) collects x, y, ux, uy, uz, scattered of the upward ones."""
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

    keep[0] = depth bins per mm below z_top, then the probability of each bin, the last for all that is deeper; None
    keeps all. z is rounded as it is stored, so that its bin can be found again from the map.
    """
    if keep is None:
        return True
    below = np.float64(np.float32(z)) - z_top
    probability = keep[1 + max(0, min(np.int64(below * keep[0]), keep.size - 2))]
    return probability >= 1.0 or draw(w, i, LANES) < probability


@kernel
def store_photon(f, w, i, stored, position, direction, z_top):
    """Writes the scattering event of lane i as photon number `stored` of the map."""
    k = np.uint64(3 * stored)
    position[k] = f[X + i]
    position[k + np.uint64(1)] = f[Y + i]
    position[k + np.uint64(2)] = f[Z + i] + z_top
    direction[stored] = w[ARRIVED + i]


@kernel
def move_lane(f, w, source, target):
    """Copies the state of one lane onto another."""
    for row in range(FLOAT_ROWS):
        f[row * LANES + target] = f[row * LANES + source]
    for row in range(INT_ROWS):
        w[row * LANES + target] = w[row * LANES + source]


@kernel
def settle(f, w, n, source, medium, relief, light, keep, position, direction, stored, tally, cursor):
    """Last pass: stores the scattering events, ends the absorbed photons and launches others in the free lanes.

    Returns (photons stored so far, whether a lane is left empty).
    """
    borders, majorant, z_top = medium.borders, medium.majorant, medium.z_top
    scatterings = PER_LAYER + medium.layers
    holes = False
    nulls = 0
    for i in range(n):
        event = w[EVENT + i]
        if event == SCATTERED:
            tally[scatterings + w[TISSUE + i]] += 1
            fresh = w[FRESH + i]
            if fresh != 0:
                w[FRESH + i] = 0
            if position is not None:
                if fresh & STRAIGHT == 0 and kept(w, i, f[Z + i] + z_top, z_top, keep):
                    store_photon(f, w, i, stored, position, direction, z_top)
                    stored += 1
        elif event == ABSORBED or w[FRESH + i] == EMPTY:
            if event == ABSORBED:
                tally[PER_LAYER + w[TISSUE + i]] += 1
            if not launch(f, w, i, source, borders, majorant, relief, light, tally, cursor):
                w[FRESH + i] = EMPTY
                holes = True
        elif w[BORDER + i] == 0:
            nulls += 1
    tally[COLLISIONS_NULL] += nulls
    return stored, holes


@kernel
def list_marked(w, n):
    """Lists the lanes whose flight may have met a border in w[MARKED:]; returns their number."""
    marked = np.uint64(0)
    for i in range(n):
        w[MARKED + marked] = i
        marked += np.uint64(w[BORDER + i])
    return marked


@kernel
def meet_borders(f, w, marked, medium, relief, tally, exits):
    """Follows the few flights that may have met a border; the lane of a photon that left is free.

    It is not used again before `settle`: this step's collision would take numbers of the new history.
    """
    borders, majorant = medium.borders, medium.majorant
    for k in range(marked):
        i = w[MARKED + k]
        status = cross(f, w, i, borders, majorant, relief)
        tally[BORDER_HITS] += w[BORDER + i]
        if status != INSIDE:
            leave(f, w, i, status, tally, exits)
            w[FRESH + i] = EMPTY


@kernel
def close_holes(f, w, n):
    """Moves the last live lanes into the empty ones; returns the number of lanes in flight."""
    i = 0
    while i < n:
        if w[FRESH + i] == EMPTY:
            n -= 1
            move_lane(f, w, n, i)
        else:
            i += 1
    return n


@kernel
def walk(f, w, source, light, medium, relief, keep, position, direction, tally, exits, state):
    """Walks the histories of `source`; returns early, to be called again, after a while and when the output is nearly full.

    Parameters
    ----------
    f, w : buffers of `lanes.new_block`.
    source : (key, first index, count, tiles x, tiles y, depth of the mean plane, store first scatterings).
    light : parameters of a lamp, see `emission`.
    medium, relief : `medium.Medium` of the band; `borders.Relief` or None.
    keep : roulette on storage, see `kept`, or None.
    position, direction : (3 n,) float32 and (n,) int32 to fill, n > LANES, or None: nothing is stored.
    tally : (columns,) int64, added to.
    exits : (histories, 6) float32 or None, see `leave`.
    state : int64 [histories used up, lanes in flight, photons stored in this call, flights since a history ended]; 0 lanes
        in flight: finished.
    """
    cursor = state[0:1]
    passes = 0
    n = state[1]
    stored = 0
    room = np.int64(0x7FFFFFFFFFFFFFFF)
    if position is not None:
        room = direction.shape[0] - LANES
    if cursor[0] == 0:
        while n < LANES and launch(f, w, n, source, medium.borders, medium.majorant, relief, light, tally, cursor):
            n += 1
    while n > 0 and stored <= room and passes < _PASSES:
        passes += 1
        launched = cursor[0]
        whole = (n + _GROUP - 1) // _GROUP * _GROUP
        fly(f, w, whole, medium.slabs)
        if medium.borders.sides == PERIODIC:
            wrap(f, whole, medium.period[0], medium.period[1])
        else:
            mark_sides(f, w, whole, medium.period[0], medium.period[1])
        marked = list_marked(w, n)
        if relief is not None:
            if medium.borders.sides == PERIODIC:
                look_around(f, w, whole, relief.cells_per_mm, relief.last_cell)
                marked = clear_of_relief(f, w, marked, medium.borders, relief)
        meet_borders(f, w, marked, medium, relief, tally, exits)
        locate(f, w, whole, medium.cells_per_mm, medium.last_cell, medium.grid.bricks_y)
        gather(f, w, n, medium.grid, medium.plane_row, medium.rows, medium.rows_as_float)
        collide(f, w, whole)
        stored, holes = settle(
            f, w, n, source, medium, relief, light, keep, position, direction, stored, tally, cursor
        )
        state[3] = 0 if holes or cursor[0] > launched else state[3] + whole
        if holes:
            n = close_holes(f, w, n)
    state[1] = n
    state[2] = stored
