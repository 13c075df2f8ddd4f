"""Storing: which scattering events are kept, and how they are written (paper, section 7.1, step 3)."""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel, kernel
from skinrender.transport.caches import stream
from skinrender.transport.lanes import (
    BAND,
    DEPTH_BIN,
    INCOMING,
    KEPT_BELOW,
    LANES,
    LISTED,
    ROLLED,
    SHOWN,
    WORDS,
    X,
    Y,
    Z,
    list_lanes,
    look_up,
)
from skinrender.transport.rng import next_word


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
    """Roulette on storage: lists those of n lanes with SHOWN set that are kept, see `roll`; returns their number."""
    look_up(keep[1].reshape(keep[1].size), w, DEPTH_BIN, w, KEPT_BELOW, n)
    keep_some(w, n)
    return list_lanes(w, n, np.uint32(SHOWN))


@block_kernel
def keep_some(w, n):
    """Clears SHOWN of n lanes where the word is larger than the largest that keeps."""
    for i in range(n):
        w[SHOWN + i] = w[SHOWN + i] if w[ROLLED + i] <= w[KEPT_BELOW + i] else np.int32(0)


@kernel
def store(f, w, shown, photons, stored, z_top):
    """Writes the lanes listed as photons number `stored` and on; returns the number of the next.

    Past the caches, but for the bands, which are read again to put the photons in order.
    """
    position, direction, band = photons
    at = np.uint64(stored)
    for k in range(shown):
        i = np.int64(np.uint32(w[LISTED + k]))
        stream(position, np.uint64(3) * at, np.float32(f[X + i]))
        stream(position, np.uint64(3) * at + np.uint64(1), np.float32(f[Y + i]))
        stream(position, np.uint64(3) * at + np.uint64(2), np.float32(f[Z + i] + z_top))
        stream(direction, at, w[INCOMING + i])
        band[at] = w[BAND + i]
        at += np.uint64(1)
    return np.int64(at)
