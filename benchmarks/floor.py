"""The floor of a photon walk on this machine: the bare block passes on a homogeneous, index-matched half space.

The same arithmetic per scattering event as the real walk (free flight, one table row, collision, deflection), and
nothing else: no voxels, slabs, borders, tallies or histories. What the real walk costs above it is the price of tissue.
"""

from __future__ import annotations

import time

import numpy as np

from skinrender.transport import block_kernel, entry_kernel, kernel
from skinrender.transport.blockmath import log_unit
from skinrender.transport.lanes import (
    ABSORB_ABOVE,
    ENDED,
    INCOMING,
    LANES,
    PATH,
    SCATTER_BELOW,
    UX,
    UY,
    UZ,
    WORDS,
    G,
    X,
    Y,
    Z,
    new_block,
)  # fmt: skip
from skinrender.transport.medium import collision_thresholds
from skinrender.transport.rng import next_word, uniform
from skinrender.transport.tally import PER_LAYER
from skinrender.transport.turn import collide


@block_kernel
def bare_fly(f, w, n, free_path):
    """Free flight in one medium; a photon that leaves through z = 0 or was absorbed starts again there."""
    for i in range(n):
        word, w0, w1, w2, w3 = next_word(
            w[WORDS + i], w[WORDS + LANES + i], w[WORDS + 2 * LANES + i], w[WORDS + 3 * LANES + i]
        )
        w[WORDS + i] = w0
        w[WORDS + LANES + i] = w1
        w[WORDS + 2 * LANES + i] = w2
        w[WORDS + 3 * LANES + i] = w3
        again = (w[ENDED + i] != np.int32(0)) | (f[Z + i] < np.float32(0.0))
        f[UX + i] = np.float32(0.0) if again else f[UX + i]
        f[UY + i] = np.float32(0.0) if again else f[UY + i]
        uz = np.float32(1.0) if again else f[UZ + i]
        f[UZ + i] = uz
        z = np.float32(0.0) if again else f[Z + i]
        path = -log_unit(uniform(word)) * free_path
        f[PATH + i] = path
        f[X + i] += f[UX + i] * path
        f[Y + i] += f[UY + i] * path
        f[Z + i] = z + uz * path


@kernel
def bare_gather(f, w, n, rows, g):
    """One row of a table per lane."""
    for i in range(n):
        row = w[INCOMING + i] & 1
        w[SCATTER_BELOW + i] = rows[row, 0]
        w[ABSORB_ABOVE + i] = rows[row, 1]
        f[G + i] = g[row]


@entry_kernel
def bare_walk(f, w, steps, free_path, rows, g):
    """Scattering and absorption events of `steps` passes over a full block."""
    for _ in range(steps):
        bare_fly(f, w, LANES, free_path)
        bare_gather(f, w, LANES, rows, g)
        collide(f, w, LANES, PER_LAYER + 1, PER_LAYER + 2)
    return steps * LANES


class Floor:
    """Times the bare walk; `measure` gives ns per event of one short run."""

    def __init__(self, mu_a: float = 0.6, mu_s: float = 40.0, g: float = 0.8):
        self.f, self.w = new_block(np.float32)
        rng = np.random.default_rng(1)
        self.w[: 4 * LANES] = rng.integers(-(2**31), 2**31 - 1, 4 * LANES)
        self.f[UZ : UZ + LANES] = 1.0
        mu_t = mu_a + mu_s
        self.free_path = np.float32(1.0 / mu_t)
        self.rows = collision_thresholds(np.full(2, mu_a), np.full(2, mu_s), np.array([mu_t]))[0]
        self.g = np.full(2, g, np.float32)
        bare_walk(self.f, self.w, 10, self.free_path, self.rows, self.g)

    def measure(self, steps: int = 2000) -> float:
        """ns per event."""
        began = time.thread_time()
        events = bare_walk(self.f, self.w, steps, self.free_path, self.rows, self.g)
        return (time.thread_time() - began) / events * 1e9
