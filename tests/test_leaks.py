"""What the check after every test sees."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys

from tests import leaks
from tests.system.soak import WARM_RENDERS, Sample, complaints


def test_semaphores_children_and_half_written_files_are_seen(tmp_path):
    before = leaks.shared_memory()
    lock = multiprocessing.get_context("spawn").Lock()
    assert len(leaks.shared_memory() - before) == 1
    del lock
    assert leaks.shared_memory() == before
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert child.pid in {pid for pid, _ in leaks.children()}
    finally:
        child.communicate(b"\n")
    assert child.pid not in {pid for pid, _ in leaks.children()}
    partial = tmp_path / ".photons.77.part.npz"
    partial.touch()
    assert leaks.partial_files(tmp_path) == {partial}
    partial.unlink()


def test_soak_complains_of_what_grows_and_of_what_is_left():
    def samples(growth: int, **more: int) -> list[Sample]:
        held = {"descriptors": 9, "threads": 2, "shared": 0, "temporary": 0, "children": 0}
        steady = [
            Sample(k, k, 300_000_000 + growth * k + 5000 * (k % 4), 0, **held) for k in range(1, 5 * WARM_RENDERS)
        ]
        return [*steady, *(Sample(99 + k, 99, steady[-1].anonymous, 0, **{**held, **more}) for k in range(4))]

    assert complaints(samples(0)) == []
    assert "memory grew" in complaints(samples(1_000_000))[0]
    assert complaints(samples(0, descriptors=10))[0].startswith("descriptors: 9 when warm")
    assert "shared: 1 left" in complaints(samples(0, shared=1))
