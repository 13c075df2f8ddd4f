"""A scene that passes validation never ends in a traceback, a number that is none, lost photons or a hang."""

from __future__ import annotations

import json
import multiprocessing
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as TookTooLong
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from skimage.io import imsave

from skinrender.analysis.stability_case import run, sound
from skinrender.errors import InputError, RunError
from skinrender.scene import make_scene
from tests.system.scenes import COLUMNS, PATTERN, scenes

SECONDS = 120
"""Of a processor, for one small scene, compiling included: on a busy machine it may take many times as long. A walk
that cannot end is given up later."""
EXAMPLES = int(os.environ.get("SEARCH_EXAMPLES", "300"))
pytestmark = pytest.mark.kills
SEARCH = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}


def told(described: dict[str, Any]) -> list[str]:
    """What is wrong with the outcome of a scene; a message to its writer is not."""
    with tempfile.TemporaryDirectory() as folder:
        pattern = np.linspace(255, 0, COLUMNS * COLUMNS).astype(np.uint8).reshape(COLUMNS, COLUMNS)
        imsave(Path(folder) / PATTERN, pattern, check_contrast=False)
        try:
            outcome = run(described, Path(folder) / "run", 1)
        except (InputError, RunError) as error:
            return [] if str(error).strip() else ["a failure without a message"]
        return [f"{one.quantity}: {one.measured:g}" for one in sound(outcome) if not one.ok]


def processor_seconds(pid: int) -> float:
    """What a process has used so far; infinite when it is gone."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return np.inf
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


class Watchdog:
    """Runs scenes in a process of its own, which is ended when one takes too long."""

    def __init__(self) -> None:
        self._begin()

    def __call__(self, described: dict[str, Any]) -> list[str]:
        [process] = self._pool._processes
        done, began = self._pool.submit(told, described), processor_seconds(process)
        while processor_seconds(process) - began < SECONDS:
            try:
                return done.result(timeout=1.0)
            except TookTooLong:
                pass
        self.end()
        self._begin()
        return [f"not done in {SECONDS} s"]

    def _begin(self) -> None:
        self._pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
        self._pool.submit(os.getpid).result()  # a process of the fixture's, not of the first test's

    def end(self) -> None:
        for process in self._pool._processes.values():
            process.kill()
        self._pool.shutdown()


@pytest.fixture(scope="module")
def watchdog() -> Iterator[Watchdog]:
    dog = Watchdog()
    yield dog
    dog.end()


@pytest.mark.slow
@settings(max_examples=12, derandomize=True, **SEARCH)
@given(described=scenes())
def test_any_scene_gives_a_picture_or_a_message(watchdog, described):
    assert watchdog(described) == [], json.dumps(described)


@pytest.mark.slow
@settings(max_examples=EXAMPLES, **SEARCH)
@given(described=scenes())
def test_search_for_a_scene_that_breaks(watchdog, described):
    assert watchdog(described) == [], json.dumps(described)


@settings(max_examples=200, derandomize=True, **SEARCH)
@given(described=scenes())
def test_drawn_scenes_are_mostly_valid(described):
    try:
        make_scene({**described, "lesions": []})
    except InputError as error:
        assert "beam reaches beyond" in str(error) or "camera" in str(error), str(error)
