"""Rounds come back in order, no more of them are begun than needed, and errors reach the caller."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pytest

from skinrender.engine.executor import ONE_THREAD, in_order
from skinrender.errors import InputError, RunError


def later_first(index: int) -> int:
    time.sleep(0.02 * (3 - index % 4))
    return index * index


@pytest.mark.parametrize("workers", [1, 3])
def test_results_come_in_the_order_of_the_indices(workers):
    indices = [4, 0, 9, 2, 7, 1]
    options = {"open_executor": lambda: ThreadPoolExecutor(workers)} if workers > 1 else {}
    assert list(in_order(later_first, indices, workers=workers, **options)) == [i * i for i in indices]


def test_endless_indices_are_taken_only_a_little_ahead():
    begun = []
    work = in_order(begun.append, itertools.count(), workers=2, open_executor=lambda: ThreadPoolExecutor(2))
    with closing(work) as results:
        list(itertools.islice(results, 5))
    assert 5 <= len(begun) <= 5 + 3


@dataclass(frozen=True)
class Report:
    folder: Path

    def __call__(self, index: int) -> tuple[int, list[str]]:
        (self.folder / str(index)).touch()
        return os.getpid(), [os.environ[name] for name in ONE_THREAD]


def test_work_is_done_in_other_processes_with_one_thread_each(tmp_path):
    with closing(in_order(Report(tmp_path), itertools.count(), workers=2)) as results:
        told = list(itertools.islice(results, 4))
    assert os.getpid() not in {pid for pid, _ in told}
    assert all(threads == ["1"] * len(ONE_THREAD) for _, threads in told)
    assert len(list(tmp_path.iterdir())) <= 4 + 3


def fail(index: int) -> None:
    raise RunError(f"round {index} failed")


@pytest.mark.parametrize("workers", [1, 2])
def test_errors_of_the_work_reach_the_caller(workers):
    with pytest.raises(RunError, match="round 8 failed"):
        list(in_order(fail, [8], workers=workers))


def test_check_ends_the_run_between_rounds():
    done = []

    def check():
        if len(done) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(in_order(done.append, itertools.count(), check=check))
    assert done == [0, 1, 2]


@pytest.mark.parametrize("workers", [0, 100_000])
def test_impossible_numbers_of_workers_are_refused(workers):
    with pytest.raises(InputError, match=f"{workers} workers"):
        next(in_order(fail, [0], workers=workers))


UNGUARDED_SCRIPT = """
import sys
from skinrender import load_scene, save_volume, build, trace
scene = load_scene(sys.argv[1])
save_volume(build(scene), sys.argv[2] + "/volume.npz")
trace(scene, sys.argv[2] + "/volume.npz", sys.argv[2] + "/out", workers=2, progress=False)
"""


@pytest.mark.kills  # the pool ends the worker that is still importing, maybe while it writes its volume
def test_a_script_without_a_guard_is_told_what_is_wrong_with_it(tmp_path, repository):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED_SCRIPT)
    command = [sys.executable, str(script), str(repository / "configs" / "slab_red.yaml"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "InputError: workers: worker processes end before they begin" in done.stderr
    assert "`if __name__ == '__main__':`" in done.stderr.splitlines()[-1]
    assert "another run" not in done.stderr and done.stderr.count("Traceback") <= 2  # the error and its cause
