"""Killed or interrupted at any moment: nothing finished is lost, nothing half-written is read, nothing stays behind."""

from __future__ import annotations

import os
import random
import signal
import time

import pytest

from tests.system.kills import (
    PATIENCE_S,
    Tally,
    campaign,
    digest,
    gone,
    hears_sigterm,
    look_over,
    set_stage,
    start,
    wait_for,
    wait_for_moment,
)

pytestmark = pytest.mark.kills
MANY = int(os.environ.get("SKINRENDER_KILLS", "60"))


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    return set_stage(tmp_path_factory.mktemp("stage"))


def assert_harmless(tally: Tally) -> None:
    assert tally.bytes_lost == 0 < tally.bytes_seen and tally.runs_compared > 0
    assert tally.semaphores_left <= 0.05 * tally.tries


def test_a_run_killed_at_random_moments_resumes_to_the_same_bytes(stage, tmp_path):
    tally = Tally()
    campaign(stage, tmp_path, 3, 4, tally)
    assert_harmless(tally)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_many_kills_of_parents_and_workers(stage, tmp_path, workers):
    tally = Tally()
    campaign(stage, tmp_path, MANY // 2, 10 + workers, tally, workers=workers)
    assert_harmless(tally)


def interrupted(process, number: int, to_group: bool = False) -> str:
    """Send a signal; what the process then said, once it ended with 130."""
    (os.killpg if to_group else os.kill)(process.pid, number)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, stdout) == (130, ""), stderr
    assert stderr.startswith("interrupted") and "Traceback" not in stderr and "Exception" not in stderr
    gone(process.pid)
    return stderr


def signal_a_trace(stage, out, number: int, moment: str, chance: random.Random, workers: int = 1) -> None:
    """Signal a run once, see what it leaves, resume it."""
    stage.begin(out)
    process = start("trace", stage, out, "-q", "--workers", str(workers))
    assert wait_for(lambda: hears_sigterm(process), process)
    if wait_for_moment(moment, process, out, chance):
        told = interrupted(process, number, to_group=workers > 1)
        assert "--resume" in told
        kept = look_over(out, stage.expected)
        assert not kept or f"{len(kept)} finished rounds are kept in {out / 'rounds'}" in told
        assert not list(out.glob(".*"))
    process = start("trace", stage, out, "-q", "--resume")
    assert process.wait(PATIENCE_S) == 0
    assert digest(out / "photons.npz") == stage.expected


@pytest.mark.parametrize(
    ("number", "moment"), [(signal.SIGINT, "walking"), (signal.SIGTERM, "writing the map")]
)
def test_a_signaled_trace_keeps_its_rounds_and_says_how_to_go_on(stage, tmp_path, number, moment):
    signal_a_trace(stage, tmp_path / "out", number, moment, random.Random(1))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["anywhere", "walking", "writing the map"])
@pytest.mark.parametrize("workers", [1, 2])
def test_signals_at_many_moments_of_a_trace(stage, tmp_path, number, moment, workers):
    chance = random.Random(int(number))
    for index in range(max(1, MANY // 30)):
        signal_a_trace(stage, tmp_path / str(index), number, moment, chance, workers)


def signal_an_estimate(stage, out, number: int, seconds: float) -> None:
    before = {path.name: digest(path) for path in out.iterdir()}
    process = start("estimate", stage, out, "-q")
    assert wait_for(lambda: hears_sigterm(process), process)
    time.sleep(seconds)
    if process.poll() is None:
        assert "go on with the same command" in interrupted(process, number)
        for path in out.iterdir():
            if path.name not in ("beam.exr", "beam.png", "timing.csv", "index.html"):
                assert before[path.name] == digest(path)


@pytest.mark.parametrize(("number", "seconds"), [(signal.SIGTERM, 0.6)])
def test_a_signaled_estimate_leaves_the_map_and_no_half_picture(stage, number, seconds):
    signal_an_estimate(stage, stage.volume.parent, number, seconds)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_at_many_moments_of_an_estimate(stage, number):
    chance = random.Random(5)
    for _ in range(MANY // 6):
        signal_an_estimate(stage, stage.volume.parent, number, chance.uniform(0, 3))


def test_a_second_run_in_the_folder_is_told_who_has_it(stage, tmp_path):
    import socket

    out = tmp_path / "out"
    stage.begin(out)
    first = start("trace", stage, out, "-q")
    lock = out / ".skinrender.lock"
    assert wait_for(lambda: lock.exists() and lock.read_text().strip(), first)
    first.send_signal(signal.SIGSTOP)
    try:
        second = start("trace", stage, out, "-q")
        stderr = second.communicate(timeout=PATIENCE_S)[1]
    finally:
        first.kill()
        first.communicate()
    assert second.returncode == 2
    assert f"process {first.pid} on host {socket.gethostname()}" in stderr
