"""The photon walk: a block of lanes through the passes until every history has ended (paper, section 7.1).

    fly -> wrap or mark_sides -> list_lanes -> look_around, clear_by_depth, clear_by_bulge (periodic, with a relief)
    -> meet_borders -> locate -> find_planes -> find_voxels -> gather -> collide -> count_events
    -> roll, thin_out (or list_lanes) -> store -> relaunch

A dead lane is relaunched in place with the next history, of the next band when one's have all begun: each lane holds
what differs between bands. With a block for each band the last histories of each, ten times as long as others, flew in
a block all but empty: rounds of 190 histories in 81 bands took 2.5 times as long.
When no history is left, the last live lane moves into the hole.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import entry_kernel, kernel
from skinrender.transport.borders import INSIDE, LEFT_BOTTOM, LEFT_TOP, PERIODIC, cross
from skinrender.transport.gather import find_planes, find_voxels, gather
from skinrender.transport.lanes import (
    BAND,
    BORDER,
    EMPTY,
    ENDED,
    EVENT,
    FRESH,
    LANES,
    LISTED,
    SHOWN,
    UNSCATTERED,
    UX,
    UY,
    UZ,
    X,
    Y,
    list_lanes,
    whole_groups,
)
from skinrender.transport.launch import close_holes, relaunch
from skinrender.transport.move import fly, locate, mark_sides, wrap
from skinrender.transport.relief import clear_by_bulge, clear_by_depth, look_around
from skinrender.transport.storing import roll, store, thin_out
from skinrender.transport.tally import (
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

# Members of a walk's state, after those in `launch`
IN_FLIGHT = 4  # lanes; 0: begins, or has ended
STORED = 5  # photons
IDLE = 6  # flights since a history ended, those of empty lanes in a group too
STATE_SIZE = 7

_PASSES = 1 << 20  # after which `walk` returns, so that whoever called it can stop


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
def count_events(w, n, tallies):
    """Tallies what happened to n lanes.

    In turn in each of the `tally.WAYS` copies: a count that waits for the one before takes 2 ns.
    """
    way = tallies.shape[1] * tallies.shape[2]
    counts = tallies.reshape(tallies.size)
    for i in range(n):
        counts[np.uint64((i & (WAYS - 1)) * way) + np.uint64(w[EVENT + i])] += 1


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


@entry_kernel
def walk(f, w, arrivals, source, medium, relief, keep, photons, tallies, exits, state):
    """Walks the histories of `source`; returns early, to be called again, after a while and when the output is filling.

    Parameters
    ----------
    f, w : buffers of `lanes.new_block`.
    arrivals : two more, in which the next histories wait.
    source : the `launch.Histories`.
    medium, relief : `medium.Medium`; `relief.Relief` or None.
    keep : roulette on storage, see `storing.roll`, or None.
    photons : position (3 n,) f4, direction (n,) i4 and band (n,) u1 to fill, n > LANES, or None: nothing is stored.
    tallies : (WAYS, B, columns) int64, added to: copies, to be summed.
    exits : (histories, 6) float32 or None, see `leave`.
    state : (STATE_SIZE,) int64, see its members.
    """
    tally = tallies[0]
    n, stored, passes = state[IN_FLIGHT], state[STORED], 0
    room = np.int64(0x7FFFFFFFFFFFFFFF)
    if photons is not None:
        room = photons[2].size - LANES
    if n == 0:
        for i in range(LANES):
            w[LISTED + i] = i
        relaunch(f, w, np.uint64(LANES), arrivals, source, medium, relief, tally, state)
        n = close_holes(f, w, np.int64(LANES))
    while n > 0 and stored <= room and passes < _PASSES:
        passes += 1
        whole = whole_groups(n)
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
        find_planes(f, w, whole, medium.grid)
        find_voxels(w, whole, medium.grid)
        gather(f, w, whole, medium.grid, medium.plane_row, medium.rows)
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
        holes = relaunch(f, w, ended, arrivals, source, medium, relief, tally, state)
        state[IDLE] = 0 if ended else state[IDLE] + whole
        if holes:
            n = close_holes(f, w, n)
    state[IN_FLIGHT], state[STORED] = n, stored
