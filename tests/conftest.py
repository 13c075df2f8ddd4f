"""What tests of all packages share."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import leaks

PATIENCE_S = 5.0


@pytest.fixture(scope="session")
def repository() -> Path:
    """The folder of the checkout, with the shipped scenes and patterns."""
    return Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def nothing_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """After every test: no shared memory, child process or half-written file that was not there before it.

    Of a test that is marked `kills`, what the killed were writing may stay, until the next run in its folder, and
    others may have taken their places.
    """
    leaks.name_semaphores()
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    kills = request.node.get_closest_marker("kills") is not None
    before = leaks.held(killed=kills)
    yield
    until = time.monotonic() + PATIENCE_S
    while (left := leaks.held(killed=kills) - before) and time.monotonic() < until:
        time.sleep(0.02)
    partial = leaks.partial_files(folder) if folder is not None and not kills else set()
    assert not left and not partial, f"left behind: {sorted(left)} {sorted(map(str, partial))}"
