"""The map's bytes do not depend on who walked it, how often it was stopped, or where."""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from fake_pass import FakeRecipe, fake_scene

from skinrender.engine import disk, work
from skinrender.engine.interrupt import Interrupted
from skinrender.engine.shards import merge
from skinrender.engine.stop import StandardError
from skinrender.engine.trace import trace
from skinrender.errors import InputError, RunError
from skinrender.photonmap import store
from skinrender.photonmap.photon_map import open_map
from skinrender.transport import tally


def run(folder: Path, **options):
    options = {"recipe": FakeRecipe(), "workers": 1, "progress": False} | options
    return trace(options.pop("scene", fake_scene()), "unused", folder, **options)


def bytes_of(folder: Path) -> str:
    return hashlib.sha256((folder / "photons.npz").read_bytes()).hexdigest()


@pytest.fixture(autouse=True)
def nothing_prepared(monkeypatch):
    """The recipes here share provenance but not their accidents."""
    monkeypatch.setattr(work, "_built", None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    run(folder)
    return folder


@pytest.mark.parametrize("workers", [2, 7])
def test_bytes_do_not_depend_on_workers(tmp_path, whole, workers):
    run(tmp_path, workers=workers)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_another_executor_gives_the_same_bytes(tmp_path, whole):
    run(tmp_path, open_executor=lambda: ThreadPoolExecutor(3), workers=3)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_another_seed_gives_other_bytes(tmp_path, whole):
    run(tmp_path, scene=fake_scene(seed=6))
    assert bytes_of(tmp_path) != bytes_of(whole)


def test_map_holds_the_photons_asked_for_and_no_round_more(whole):
    photon_map = open_map(whole / "photons.npz", check_photons=True)
    assert len(photon_map) >= 4000 > photon_map.round_slice(photon_map.rounds - 1).start
    assert photon_map.rounds >= 32
    assert np.array_equal(photon_map.emitted_per_band, photon_map.tallies[..., tally.EMITTED].sum(axis=0))
    assert np.allclose(photon_map.power_per_band * photon_map.emitted_per_band, [1.0, 3.0, 0.5])
    assert not (whole / "rounds").exists()


@pytest.mark.parametrize("stored", [0, 1, 100])
def test_tiny_runs(tmp_path, stored):
    summary = run(tmp_path, scene=fake_scene(stored))
    assert summary.stored >= stored and summary.rounds == 32


def test_scene_that_stores_nothing_ends_with_an_empty_map(tmp_path):
    summary = run(tmp_path, recipe=FakeRecipe(stored=False))
    assert summary.stored == 0 == len(open_map(tmp_path / "photons.npz", check_photons=True))


def interrupted(folder: Path, **options) -> Path:
    """A folder whose run was stopped after some rounds."""
    with pytest.raises(Interrupted, match="--resume"):
        run(folder, recipe=FakeRecipe(accident=("interrupt", folder)), **options)
    return folder / "rounds"


def walked_on(folder: Path, rounds: int) -> Path:
    """A folder with the first rounds of the run, as an interrupted run leaves it."""
    rounds_dir = interrupted(folder)
    recipe = FakeRecipe()
    key = store.read_header(rounds_dir / "run.npz").key
    histories = np.array(store.read_header(rounds_dir / "run.npz").provenance["histories_per_round"])
    for index in range(rounds):
        store.write_round(rounds_dir, key, recipe.build(5).walk(index, histories, True))
    return rounds_dir


def test_interrupt_keeps_the_round_under_way(tmp_path, whole):
    rounds_dir = interrupted(tmp_path)
    assert [path.name for path in rounds_dir.glob("round-*")] == ["round-000000.npz"]
    assert not (tmp_path / "photons.npz").exists()
    run(tmp_path, resume=True)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_resume_walks_only_what_is_missing(tmp_path, whole):
    rounds_dir = walked_on(tmp_path, 36)
    for index in random.Random(1).sample(range(36), 9):
        store.round_path(rounds_dir, index).unlink()
    summary = run(tmp_path, resume=True, workers=2)
    assert bytes_of(tmp_path) == bytes_of(whole)
    assert summary.counts.sum() == run(whole, resume=True).counts.sum()


@pytest.mark.parametrize("harm", ["cut", "flip", "empty", "garbage"])
def test_damaged_rounds_are_walked_again(tmp_path, whole, harm):
    path = store.round_path(walked_on(tmp_path, 5), 3)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    if harm == "flip":
        data[middle] ^= 1
    path.write_bytes({"cut": data[:middle], "flip": data, "empty": b"", "garbage": b"PK\3\4" * 500}[harm])
    run(tmp_path, resume=True)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_resume_refuses_rounds_of_another_scene(tmp_path):
    rounds_dir = walked_on(tmp_path, 3)
    with pytest.raises(InputError, match="differs in: fake"):
        run(tmp_path, resume=True, recipe=FakeRecipe(name="other"))
    assert len(store.round_files(rounds_dir)) == 3
    run(tmp_path, recipe=FakeRecipe(name="other"))


def test_resume_refuses_rounds_of_an_unlike_machine(tmp_path, monkeypatch):
    walked_on(tmp_path, 3)
    monkeypatch.setattr("skinrender.engine.run.machine_identity", lambda: {"processor": "another"})
    with pytest.raises(InputError, match="differs in: machine"):
        run(tmp_path, resume=True)


def test_resuming_a_finished_run_is_success_and_changes_nothing(whole):
    before = (whole / "photons.npz").stat().st_mtime_ns
    again = run(whole, resume=True)
    assert (whole / "photons.npz").stat().st_mtime_ns == before
    assert again.stored == len(open_map(whole / "photons.npz"))


def test_killed_worker_is_replaced(tmp_path, whole):
    run(tmp_path, workers=2, recipe=FakeRecipe(accident=("dies once", tmp_path)))
    assert (tmp_path / "dies once.note").exists()
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_workers_that_keep_dying_end_the_run(tmp_path):
    with pytest.raises(RunError, match="fewer --workers"):
        run(tmp_path, workers=2, recipe=FakeRecipe(accident=("always dies", tmp_path)))


@pytest.mark.parametrize("workers", [1, 2])
def test_out_of_memory_is_told_and_what_is_finished_kept(tmp_path, whole, workers, monkeypatch):
    rounds_dir = walked_on(tmp_path, 3)
    kept = set(rounds_dir.glob("round-*"))
    monkeypatch.setattr(work, "_built", None)
    with pytest.raises(RunError, match="out of memory.*\n.*--resume and fewer --workers"):
        run(tmp_path, workers=workers, resume=True, recipe=FakeRecipe(accident=("out of memory", tmp_path)))
    assert kept <= set(rounds_dir.glob("round-*"))
    run(tmp_path, workers=workers, resume=True)
    assert bytes_of(tmp_path) == bytes_of(whole)


PROGRAM = f"""
import sys
sys.path[:0] = {[str(Path(__file__).parent), *sys.path]!r}
from fake_pass import FakeRecipe, fake_scene
from skinrender.engine.trace import trace
if __name__ == "__main__":
    recipe = FakeRecipe(slow_s=0.02)
    trace(fake_scene(), "unused", sys.argv[1], workers=int(sys.argv[2]), resume=True, recipe=recipe)
"""


def test_killed_run_resumes_to_the_same_bytes(tmp_path, whole):
    """SIGKILL at random moments, as often as it takes."""
    script, folder, moments = tmp_path / "run.py", tmp_path / "out", random.Random(3)
    script.write_text(PROGRAM)
    walked = [0]
    for workers in ("1", "2", "1"):
        process = subprocess.Popen([sys.executable, str(script), str(folder), workers])
        deadline = time.monotonic() + 20
        while len(store.round_files(folder / "rounds")) <= walked[-1] and time.monotonic() < deadline:
            time.sleep(0.005)
        time.sleep(moments.uniform(0, 0.1))
        process.kill()
        process.wait()
        walked.append(len(store.round_files(folder / "rounds")))
    assert 0 < walked[1] < walked[2] < walked[3] < 36
    run(folder, resume=True)
    assert bytes_of(folder) == bytes_of(whole)
    assert {path.name for path in folder.iterdir()} == {"photons.npz"}


def test_signal_stops_a_run_over_processes_and_its_workers(tmp_path, whole):
    recipe = FakeRecipe(slow_s=0.05)
    pid = os.getpid()
    with ThreadPoolExecutor(1) as beside:
        beside.submit(lambda: (time.sleep(1.0), os.kill(pid, signal.SIGTERM)))
        with pytest.raises(Interrupted):
            run(tmp_path, workers=2, recipe=recipe, scene=fake_scene())
    run(tmp_path, resume=True)
    assert bytes_of(tmp_path) == bytes_of(whole)


@pytest.mark.parametrize("shards", [1, 3])
def test_shards_merge_to_the_whole(tmp_path, whole, shards):
    folders = [tmp_path / str(index) for index in range(shards)]
    for index, folder in enumerate(folders):
        run(folder, shard=(index, shards))
    summary = merge(folders, tmp_path / "merged")
    assert bytes_of(tmp_path / "merged") == bytes_of(whole)
    assert summary.stored == len(open_map(whole / "photons.npz"))


def test_merge_names_a_missing_round_and_a_strange_shard(tmp_path):
    run(tmp_path / "0", shard=(0, 2))
    with pytest.raises(InputError, match="round 1 is in none"):
        merge([tmp_path / "0"], tmp_path / "merged")
    run(tmp_path / "1", shard=(1, 2), scene=fake_scene(seed=9))
    with pytest.raises(InputError, match="differs in: seed"):
        merge([tmp_path / "0", tmp_path / "1"], tmp_path / "merged")


@pytest.mark.parametrize("shard", [(2, 2), (-1, 2), (0, 0)])
def test_impossible_shards_are_refused(tmp_path, shard):
    with pytest.raises(InputError, match="no shard"):
        run(tmp_path, shard=shard)


def test_shards_refuse_other_stop_rules(tmp_path):
    with pytest.raises(InputError, match="stop rule"):
        run(tmp_path, shard=(0, 2), stop=StandardError(0.01))


def test_target_error_is_another_end_of_the_same_run(tmp_path):
    loose = run(tmp_path / "a", stop=StandardError(0.05, 0.2))
    tight = run(tmp_path / "b", stop=StandardError(0.0065, 0.02))
    assert loose.rounds == 32 < tight.rounds
    assert tight.total_stderr[tally.REFLECTED] <= 0.0065
    with np.load(tmp_path / "a/photons.npz") as a, np.load(tmp_path / "b/photons.npz") as b:
        assert np.array_equal(a["position"], b["position"][: len(a["position"])])


def test_lost_photons_fail_the_run(tmp_path):
    with pytest.raises(RunError, match="unaccounted"):
        run(tmp_path, recipe=FakeRecipe(lose=True))


def test_too_little_room_is_said_beforehand(tmp_path, monkeypatch):
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda _: type("Usage", (), {"free": 1000}))
    with pytest.raises(RunError, match="the disk has 1 kB left"):
        run(tmp_path)


def test_full_disk_keeps_finished_rounds(tmp_path, whole, monkeypatch):
    write = store.write_npz

    def fill_up(path, members):
        if path.name == "round-000004.npz":
            raise RunError(f"{path}: full") from OSError(28, "No space left on device")
        write(path, members)

    with monkeypatch.context() as patch:
        patch.setattr(store, "write_npz", fill_up)
        with pytest.raises(RunError, match="go on with --resume"):
            run(tmp_path)
    assert len(store.round_files(tmp_path / "rounds")) == 4
    run(tmp_path, resume=True)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_folder_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(RunError, match="cannot be written"):
        run(tmp_path / "out")
