"""A picture that grows while its photons are walked, until it is good enough or its time is over.

Photons go from the walk into the estimate, some rounds at a time, and are forgotten: memory does not grow with their
number, and no map is needed. The rounds are independent, so the picture is the mean of the parts.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

from tqdm import tqdm

from skinrender.engine.beside import beside
from skinrender.engine.clock import StageClock
from skinrender.engine.estimate import EstimateSummary, open_view, summarize
from skinrender.engine.executor import in_order
from skinrender.engine.interrupt import Interrupt, listen
from skinrender.engine.recipe import Recipe
from skinrender.engine.run import Run, plan_run
from skinrender.engine.summary import TraceSummary
from skinrender.engine.work import photon_pass
from skinrender.errors import SceneError
from skinrender.estimate.scatter_image import pooled
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.photon_pass import Round
from skinrender.scene import about
from skinrender.skin.volume import SkinVolume

ROUND_STORED = 200_000
FIRST_ROUNDS = 20
"""Batches of the first part; its error tells how many rounds are needed."""
PART_STORED = 1 << 24
"""Photons held at once, 285 MB, and for a moment twice: each part makes the rays' optical depths again."""
ERROR_MARGIN = 1.05
"""More rounds than the error so far asks for, as it is known to some percent itself."""


@dataclass(frozen=True)
class Goal:
    """When a picture is done: with the first of these.

    Parameters
    ----------
    error : mean over the pixels of the standard error of luminance, relative, is at most this.
    deadline : `time.monotonic` at which the picture is to be there.
    """

    error: float | None = None
    deadline: float | None = None


@dataclass(frozen=True)
class Part:
    """What a part of the picture took: its rounds, the seconds of their walk, and those of estimating and showing it."""

    rounds: int
    walk: float
    rest: float


def next_rounds(goal: Goal, parts: list[Part], error: float | None, most: int, now: float) -> int:
    """Rounds of the next part, at most `most`; 0 when the goal is reached.

    Parameters
    ----------
    parts : done so far; error : of their picture, None if it has none, as it is dark.
    """
    if not parts:
        return min(FIRST_ROUNDS, most)
    done = sum(part.rounds for part in parts)
    wanted = most
    if goal.error is not None:
        if error is None or error <= goal.error:
            return 0
        wanted = max(math.ceil(done * (ERROR_MARGIN * error / goal.error) ** 2) - done, 2)
    if goal.deadline is not None:
        wanted = min(wanted, rounds_in(goal.deadline - now, parts))
    return min(wanted, most)


def rounds_in(seconds: float, parts: list[Part]) -> int:
    """Rounds that can be walked, estimated and shown in some seconds, as the parts so far tell; 0 for less than 2.

    The rest of a part is a start, the same for all, and a share for each round; a single part, whose start may have
    compiled kernels, does not tell them apart and is taken for all start.
    """
    walk = parts[-1].walk / parts[-1].rounds
    start, each = parts[-1].rest, 0.5 * walk
    if len(parts) > 1 and parts[-1].rounds != parts[-2].rounds:
        each = max(0.0, (parts[-1].rest - parts[-2].rest) / (parts[-1].rounds - parts[-2].rounds))
        start = max(0.0, parts[-1].rest - each * parts[-1].rounds)
    rounds = int(max(0.0, seconds - start) / (walk + each))
    return rounds if rounds >= 2 else 0


def render_until(
    goal: Goal,
    scene: Any,
    volume: SkinVolume,
    recipe: Recipe,
    show: Callable[[SpectralImage, EstimateSummary], None],
    *,
    threads: int | None = None,
    compiled: Callable[[], object] = lambda: None,
    progress: bool = True,
    clock: StageClock | None = None,
) -> TraceSummary:
    """Walk and estimate until the goal is reached.

    Parameters
    ----------
    scene, volume : as `estimate.estimate` takes them.
    recipe : of the photon pass in this volume.
    show : receives the picture so far, and what is told of it, after each part.
    threads : that walk and estimate; all cores by default.
    compiled : waits for kernels that others compile, see `ahead.kernels_ahead`.
    clock : receives the seconds of the stages ``load``, ``trace``, ``estimate`` (and those that `show` adds).

    Raises
    ------
    InputError : a wanted gather count, which only a known number of photons can have.
    Interrupted : by SIGINT or SIGTERM; the last picture shown stays.
    """
    with about(scene, "estimate"):
        _refuse_gather_count(scene)
    clock, threads = clock or StageClock(), threads or os.cpu_count() or 1
    view = open_view(scene, volume, FIRST_ROUNDS, threads=threads)
    prepared = beside(lambda: (compiled(), view.prepare()))
    with clock.stage("load"):
        run, plan = plan_run(recipe, scene.photons.seed, FIRST_ROUNDS * 2 * ROUND_STORED, scene.photons.wavelengths)
        walker = _Walker(run, threads, progress)
    ledger, parts, scattered, error = run.new_ledger(), [], None, None
    most = max(FIRST_ROUNDS, int(PART_STORED / max(plan.stored_per_round, 1.0)))
    with listen() as interrupt:
        while count := next_rounds(goal, parts, error, most, time.monotonic()):
            began = time.monotonic()
            with clock.stage("trace"):
                walked = list(walker.walk(len(ledger.rounds), count, interrupt))
                for one in walked:
                    ledger.add(one)
            walk_seconds = time.monotonic() - began
            with clock.stage("estimate"):
                prepared()
                photon_map = map_from_rounds(walker.photon_pass, walked)
                del walked
                part = view.scattered(photon_map, progress)
                del photon_map
                scattered = part if scattered is None else pooled(scattered, part)
                image = view.image(scattered, {"photon_map": {**run.header.provenance, "rounds": len(ledger.rounds)}})
            summary = summarize(view, image, scattered, clock)
            error = summary.stderr_relative_mean
            show(image, summary)
            interrupt.check()
            parts.append(Part(count, walk_seconds, time.monotonic() - began - walk_seconds))
    return replace(run.summary(ledger), seconds=clock.seconds)


def _refuse_gather_count(scene: Any) -> None:
    if scene.estimate.gather_count is not None:
        raise SceneError(
            "a picture that grows has no number of photons to take a gather count from", key=("gather_count",),
            remedy="leave it out, or give a number of photons instead of an error or a time",
        )  # fmt: skip


class _Walker:
    """Walks rounds on threads; the kernels release the interpreter lock."""

    def __init__(self, run: Run, threads: int, progress: bool):
        self.photon_pass = photon_pass(run.recipe, run.seed)
        self._histories = run.histories
        self._threads = threads
        self._hide = None if progress else True

    def walk(self, first: int, count: int, interrupt: Interrupt) -> Iterator[Round]:
        """Rounds first .. first + count - 1, in order."""
        rounds = in_order(
            self._walk_one, range(first, first + count), workers=self._threads, check=interrupt.check,
            open_executor=lambda: ThreadPoolExecutor(self._threads),
        )  # fmt: skip
        with closing(rounds), tqdm(total=count, unit=" rounds", disable=self._hide, desc="trace", leave=False) as bar:
            for one in rounds:
                yield one
                bar.update()

    def _walk_one(self, index: int) -> Round:
        return self.photon_pass.walk(index, self._histories, True)

