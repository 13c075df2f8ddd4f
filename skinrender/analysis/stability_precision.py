"""Where float32 is used, against float64: the blocks of the walk, directions over many turns, sums of photons in a
pixel.

float32 holds: the lanes of a block (unless `medium.block_type` finds them too coarse), stored positions and directions,
what a photon is worth to a ray, optical depths of rays, filtered slab images. Sums of photons are float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skinrender.analysis.slab_stats import Z_BOUND
from skinrender.analysis.slab_walk import record_seed
from skinrender.analysis.stability_case import Case, Measure, Outcome
from skinrender.analysis.stability_judges import same_share
from skinrender.analysis.stability_scenes import NORMAL, layer, slab
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from skinrender.transport import entry_kernel, tally
from skinrender.transport.blockmath import cos_sin_turn, log_unit
from skinrender.transport.rng import uniform

HISTORIES = 100_000
FOREARM = {
    "patch": {"size_mm": [1.0, 1.0], "columns": [16, 16]}, "bands_nm": [650], "skin": {"site": "forearm"},
    "light": NORMAL,
}  # fmt: skip
WALKED: Mapping[str, Mapping[str, Any]] = {
    "forearm with relief": FOREARM,
    "deep: 30 mm of clear tissue over 3 mm": slab(layer(30.0, 0.001, 0.1, 0.8, 1.4), layer(3.0, 0.1, 20.0, 0.8, 1.4)),
    "paths of 1e5 scatterings: albedo 1, optical depth 400": slab(layer(40.0, 0.0, 10.0, 0.0, 1.4)),
    "thin: 0.02 mm of absorber between": slab(
        layer(1.0, 0.1, 20.0, 0.8, 1.4), layer(0.02, 5.0, 5.0, 0.5, 1.5), layer(1.0, 0.1, 20.0, 0.8, 1.33)
    ),
}
TURNS = 100_000
WORTHS = 1 << 20
PIXEL_PHOTONS = 1_000_000_000
LIMITS = (-(2**31), -(2**31) + 1, -2, -1, 0, 1, 2, 3, 2**30, 2**31 - 2, 2**31 - 1)
"""Words of the generator that give the smallest and largest variates, and those about its middle."""


def walked(described: Mapping[str, Any], real: type, seed: int) -> np.ndarray:
    """Tallies of a walk in blocks of a number type."""
    scene = make_scene(dict(described))
    photon_pass = PhotonPass(build_volume(scene), light_from_scene(scene), seed, real=real)
    return photon_pass.walk(0, np.full(photon_pass.bands, HISTORIES), False).tallies.sum(axis=0)


def same_walk(name: str) -> Callable[[Sequence[Outcome]], Iterator[Measure]]:
    """Judge: float32 and float64 blocks send the same light to the same fates."""

    def judge(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
        counts = [
            walked(WALKED[name], real, record_seed(1, name, side)) for side, real in enumerate((np.float32, np.float64))
        ]
        layers = (len(counts[0]) - tally.PER_LAYER) // 2
        absorbed = range(tally.PER_LAYER, tally.PER_LAYER + layers)
        fates = [tally.REFLECTED, tally.TRANSMITTED, tally.TRANSMITTED_UNSCATTERED, *absorbed]
        found = [same_share(int(counts[0][fate]), int(counts[1][fate]), HISTORIES, HISTORIES) for fate in fates]
        yield Measure("z of R, T, A between float32 and float64", max(map(abs, found)), Z_BOUND)

    return judge


def many_turns(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Directions of a block after `TURNS` scatterings: of length 1, and even over the sphere."""
    from skinrender.transport.lanes import ABSORB_ABOVE, LANES, SCATTER_BELOW, UX, UY, UZ, WORDS, G, new_block
    from skinrender.transport.turn import collide

    f, w = new_block(np.float32)
    w[WORDS : WORDS + 4 * LANES] = np.random.default_rng(1).integers(-(2**31), 2**31, 4 * LANES)
    f[UX : UX + LANES], f[UY : UY + LANES], f[UZ : UZ + LANES] = 0.0, 0.0, 1.0
    f[G : G + LANES] = 0.9
    w[SCATTER_BELOW : SCATTER_BELOW + LANES], w[ABSORB_ABOVE : ABSORB_ABOVE + LANES] = 2**31 - 1, 2**31 - 1
    for _ in range(TURNS):
        collide(f, w, LANES, tally.PER_LAYER + 1, tally.columns(1))
    u = np.stack([f[k : k + LANES] for k in (UX, UY, UZ)]).astype(float)
    yield Measure("length's deviation from 1", float(np.abs(np.linalg.norm(u, axis=0) - 1.0).max()), 1e-6)
    z = u.mean(axis=1) * math.sqrt(3.0 * LANES)
    yield Measure("z of the mean direction", float(np.abs(z).max()), Z_BOUND)


@entry_kernel
def running_sum(worth, count):
    """Sum of `count` float32 values, taken again and again from an array, as `deposit` adds to a bin: one by one in
    float64."""
    total = 0.0
    for k in range(count):
        total += worth[k % len(worth)]
    return total


def one_pixel(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Sum of `PIXEL_PHOTONS` photons in one pixel, against an exact sum; allowed is a hundredth of their own noise.

    What a photon is worth spreads over orders of magnitude: phase function times transmittance, here log-normal.
    """
    rng = np.random.default_rng(2)
    worth = np.exp(1.5 * rng.standard_normal(WORTHS, dtype=np.float32))
    whole, rest = divmod(PIXEL_PHOTONS, WORTHS)
    exact = whole * math.fsum(worth.astype(float)) + math.fsum(worth[:rest].astype(float))
    error = abs(running_sum(worth, PIXEL_PHOTONS) / exact - 1.0)
    yield Measure("relative error of the sum", float(error), 0.01 / math.sqrt(PIXEL_PHOTONS))


def elementary(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Logarithm and turn of the walk's variates at their limits and between, against double precision."""
    words = np.concatenate([LIMITS, np.random.default_rng(3).integers(-(2**31), 2**31, 20_000)]).astype(np.int32)
    variates = [uniform(word) for word in words]
    logs = [(float(log_unit(u)), math.log(float(u))) for u in variates]
    yield Measure("relative error of log", max(abs(got / log - 1.0) if log else abs(got) for got, log in logs), 3e-7)
    yield Measure("longest free path / mean", max(-got for got, _ in logs), 32 * math.log(2.0) * (1 + 3e-7))
    off = 0.0
    for u in variates:
        turn = np.float32(u) - np.float32(0.5)
        cosine, sine = cos_sin_turn(turn)
        angle = 2.0 * math.pi * float(turn)
        off = max(off, abs(float(cosine) - math.cos(angle)), abs(float(sine) - math.sin(angle)))
    yield Measure("error of cos and sin", off, 1e-6)


CASES = (
    *(
        Case(f"float32 and float64: {name}", "rounding of depths and optical depths in the lanes", [], same_walk(name))
        for name in WALKED
    ),
    Case(
        "float32: 1e5 turns of a direction",
        "a direction whose length drifts; a pole of the frame",
        [],
        many_turns,
    ),
    Case(
        "float32: log, cos and sin at their limits",
        "the logarithm of 0 or of more than 1; a quadrant's border",
        [],
        elementary,
    ),
    Case(
        "1e9 photons in one pixel",
        "a float32 sum stops growing at 2^24 times what is added",
        [],
        one_pixel,
    ),
)
