"""Walking photons through a stack of a truth file, by the way of any scene: scene, volume, photon pass, rounds."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.analysis.slab_stats import Result
from skinrender.analysis.slab_truth import SlabRecord, Stack
from skinrender.engine.crew import Crew
from skinrender.engine.ledger import Batches, Ledger, check_counts
from skinrender.engine.recipe import scene_recipe
from skinrender.engine.run import count_light
from skinrender.engine.stop import MIN_ROUNDS
from skinrender.engine.summary import TraceSummary
from skinrender.errors import InputError
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass, Round
from skinrender.scene import Scene, make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import save_volume
from skinrender.transport import tally

ROUNDS = 128
"""Batches for the standard errors of a result: with 32, 4 standard errors are exceeded three times as often."""
ROUND_HISTORIES = 1 << 10
"""Worth keeping in a round, even if it costs batches: at the end of a round a few long histories walk alone."""
PATCH_MM = 10.0
LEAST_HISTORIES = 1 << 14
PILOT_HISTORIES = 1 << 12
MOST_EVENTS = 2e10
"""Scattering events of one record; some minutes on one core."""
_MARGIN, _MARGIN_EVENTS = 0.9, 0.75
"""Part of the wanted standard error that is aimed at; that of events is itself known from a pilot only."""
_PILOT_ERROR = 0.07


@dataclass(frozen=True)
class Accuracy:
    """Wanted standard errors: of fractions, and relative ones of events where there is at least one a history."""

    fraction: float
    events: float


@dataclass(frozen=True, eq=False)
class RecordCheck:
    """What the check of one record found.

    Parameters
    ----------
    results : of all its quantities.
    histories, scatterings : walked for them.
    seconds : spent.
    note : what the user should know, or "".
    """

    results: tuple[Result, ...]
    histories: int
    scatterings: int
    seconds: float
    note: str = ""


@dataclass(frozen=True)
class FixedRounds:
    """Stop rule: a number of rounds settled beforehand, whatever they say."""

    count: int

    def met(self, ledger: Ledger) -> bool:
        return len(ledger.rounds) >= self.count


def stack_scene(
    record: SlabRecord, *, cuts_mm: Sequence[float] = (), size_mm: float = PATCH_MM, pencil: bool = False
) -> Scene:
    """The scene of a record's stack: one band, periodic sides.

    Parameters
    ----------
    cuts_mm : depths at which layers are divided, so that each part is counted apart; see `parts`.
    size_mm : side of the patch.
    pencil : a pencil beam at its center in place of light all over it.
    """
    stack = record.stack
    if stack.incidence == "diffuse":
        light: dict[str, Any] = {"kind": "sky"}
    else:
        light = {"kind": "collimated", **({"radius_mm": 0.0} if pencil else {})}
    described = {
        "patch": {"size_mm": [size_mm, size_mm], "columns": [1, 1]},
        "bands_nm": [550.0],
        "slab": {"layers": [_described(stack, *part) for part in parts(stack, cuts_mm)]},
        "outside": {"refractive_index": stack.n_above},
        "below": {"refractive_index": stack.n_below},
        "inner_borders": "fresnel",
        "light": {**light, "spectrum": "E"},
    }
    try:
        return make_scene(described)
    except InputError as error:
        told = "\n  ".join(str(error).splitlines())
        raise InputError("no scene can be made of its layers", where=record.where, remedy=told) from None


def parts(stack: Stack, cuts_mm: Sequence[float] = ()) -> list[tuple[int, float, float]]:
    """Parts of the layers between cuts: index of the layer, upper and lower depth (mm), top to bottom."""
    borders = stack.depth_mm
    found = []
    for i, (top, bottom) in enumerate(pairwise(borders)):
        edges = [top, *sorted({float(z) for z in cuts_mm if top < z < bottom}), bottom]
        found += [(i, upper, lower) for upper, lower in pairwise(edges)]
    return found


def _described(stack: Stack, layer: int, top: float, bottom: float) -> dict[str, float]:
    optics, is_whole = stack.layers[layer], (top, bottom) == stack.depth_mm[layer : layer + 2]
    return {
        "thickness_mm": optics.thickness_mm if is_whole else bottom - top,
        "mu_a_per_mm": optics.mu_a,
        "mu_s_per_mm": optics.mu_s,
        "g": optics.g,
        "refractive_index": optics.n,
    }


def rounds_for(histories: int) -> int:
    """Number of rounds to share histories over."""
    return min(ROUNDS, max(MIN_ROUNDS, histories // ROUND_HISTORIES))


def count_rounds(scene: Scene, seed: int, histories: int) -> TraceSummary:
    """Walk at least so many histories, in rounds, without storing photons."""
    rounds = rounds_for(histories)
    with tempfile.TemporaryDirectory(prefix="skinrender-") as folder:
        path = Path(folder) / "volume.npz"
        save_volume(build_volume(scene), path)
        share = np.array([-(-histories // rounds)])
        crew = Crew(workers=1, progress=False)
        return count_light(scene_recipe(scene, path), seed, share, FixedRounds(rounds), crew=crew)


def walked_rounds(
    scene: Scene, seed: int, histories: int, rounds: int, *, store: bool = False
) -> Iterator[tuple[Round, np.ndarray]]:
    """Walk `rounds` rounds of `histories`; yields each with the photons that left upwards, see `PhotonPass.walk`."""
    photon_pass = PhotonPass(build_volume(scene), light_from_scene(scene), seed)
    for index in range(rounds):
        exits: list[np.ndarray] = []
        walked = photon_pass.walk(index, np.array([histories]), store, exits)
        check_counts(walked)
        yield walked, exits[0]


def scatterings_per_history(scene: Scene, seed: int) -> float:
    """Mean number of scattering events of a history, from a small pilot."""
    layers = len(scene.slab.layers)
    [(pilot, _)] = walked_rounds(scene, seed, PILOT_HISTORIES, 1)
    return float(pilot.tallies[0, tally.scattered(layers)].sum()) / PILOT_HISTORIES


class Means(Batches):
    """Batches with their mean."""

    @property
    def mean(self) -> np.ndarray:
        return self._mean


def record_seed(seed: int, record_id: str, stage: int = 0) -> int:
    """Seed of a record's photons: independent of those of other records, whatever else is walked."""
    words = np.random.SeedSequence([seed, stage, *record_id.encode()]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def histories_for_fractions(expected: Sequence[float], stderr: float) -> int:
    """Histories that bring the binomial standard errors of all these fractions below `stderr`."""
    variance = max((p * (1.0 - p) for p in expected), default=0.0)
    return max(LEAST_HISTORIES, math.ceil(variance / (_MARGIN * stderr) ** 2))


def planned_histories(
    walk: Callable[[int, int], TraceSummary],
    fractions: Sequence[float],
    scatter_events: Sequence[float],
    wanted: Accuracy,
) -> tuple[int, bool]:
    """Number of histories, settled before the first one that counts; and whether it had to be limited.

    A run that ends when its own standard error has become small ends sooner where rare long histories happen to be
    missing: its mean is then too low and its standard error far too low. So nothing that counts decides its own
    number: fractions need what follows from their expected values, scattering events what follows from a pilot, which
    is thrown away. A pilot that does not know the events to `_PILOT_ERROR` doesn't know their variance either; then a
    larger one is walked.

    Parameters
    ----------
    walk : walks a pilot: (its number, histories) -> counts.
    fractions, scatter_events : expected.
    """
    enough = histories_for_fractions(fractions, wanted.fraction)
    most = max(LEAST_HISTORIES, int(MOST_EVENTS / max(1.0, sum(scatter_events))))
    if max(scatter_events, default=0.0) >= 1.0:
        pilot, number = PILOT_HISTORIES, 1
        error = _worst_error(walk(number, pilot), scatter_events)
        while error > _PILOT_ERROR and 2 * pilot < most:
            growth = math.ceil((error / _PILOT_ERROR) ** 2)
            pilot, number = min(pilot * max(2, growth), most // 2), number + 1
            error = _worst_error(walk(number, pilot), scatter_events)
        enough = max(enough, math.ceil(pilot * (error / (_MARGIN_EVENTS * wanted.events)) ** 2))
    return min(enough, most), enough > most


def _worst_error(pilot: TraceSummary, expected: Sequence[float]) -> float:
    """Largest relative standard error of the scattering events in a layer, where there is at least one a history."""
    errors = pilot.fractions_stderr[0, tally.scattered(len(expected))]
    return max(error / mean for error, mean in zip(errors, expected) if mean >= 1.0)


def pilot_walk(scene: Scene, seed: int, record_id: str) -> Callable[[int, int], TraceSummary]:
    """The walk of a record's pilots, each with a seed of its own."""
    return lambda number, histories: count_rounds(scene, record_seed(seed, record_id, number), histories)
