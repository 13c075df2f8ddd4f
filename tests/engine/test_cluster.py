"""A photon pass on a dask cluster: the same bytes, through a worker's death, and clear refusals."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from fake_pass import FakePass

from skinrender.engine import bands, work
from skinrender.engine.estimate import estimate
from skinrender.engine.trace import trace
from skinrender.errors import InputError, RunError
from skinrender.photonmap import store
from skinrender.photonmap.photon_map import open_map
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import load_volume, save_volume

distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

from skinrender.engine import cluster as cluster_module  # noqa: E402
from skinrender.engine.cluster import connect, identity, refuse_unlike  # noqa: E402

SLAB = {
    "patch": {"size_mm": [1, 1], "columns": [1, 1]},
    "bands_nm": [450, 650],
    "slab": {
        "layers": [{"thickness_mm": 1, "mu_a_per_mm": 0.1, "mu_s_per_mm": 20, "g": 0.8, "refractive_index": 1.4}]
    },
    "light": {"kind": "collimated"},
    "photons": {"stored": 3e6, "roulette": False},
}


def bytes_of(folder: Path) -> str:
    return hashlib.sha256((folder / "photons.npz").read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def volume(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("volume") / "volume.npz"
    save_volume(build_volume(make_scene(SLAB)), path)
    return path


def test_an_address_that_answers_nothing_is_refused_in_time(monkeypatch):
    assert cluster_module.REACH_SECONDS <= 5
    monkeypatch.setattr(cluster_module, "REACH_SECONDS", 0.5)
    began = time.monotonic()
    with pytest.raises(InputError, match="127.0.0.1:9 cannot be reached"), connect("tcp://127.0.0.1:9"):
        pass
    assert time.monotonic() - began < 5


@pytest.mark.parametrize(("says", "told"), [
    (b"", "what listens there does not answer"), (b"HTTP/1.1 400 Bad Request\r\n\r\n", "no dask scheduler"),
])  # fmt: skip
def test_another_service_is_refused_in_time(monkeypatch, says, told):
    """One that keeps silent, and one of another protocol."""
    monkeypatch.setattr(cluster_module, "REACH_SECONDS", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as service:
        accepted = service.submit(_accept, server, says)
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InputError, match=told), connect(address):
            pass
        accepted.result().close()


def _accept(server, says):
    connection = server.accept()[0]
    connection.sendall(says)
    return connection


@pytest.mark.parametrize("address", ["nowhere", "carrier-pigeon://1.2.3.4:5", ""])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(InputError, match="--scheduler"), connect(address):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"skinrender\[cluster\]"), connect("tcp://127.0.0.1:9"):
        pass


@pytest.mark.parametrize(("part", "key"), [("program", "walk"), ("program", "numba"), ("processor", "features")])
def test_workers_of_another_program_or_processor_are_refused(part, key):
    other = {name: dict(values) for name, values in identity().items()}
    other[part][key] = "another"
    with pytest.raises(InputError, match=f"worker tcp://a:1 .*{part}.*{key} another"):
        refuse_unlike(other, identity(), "tcp://a:1")
    refuse_unlike(identity(), identity(), "tcp://a:1")


def test_threads_prepare_a_pass_once(monkeypatch):
    """Two threads of one worker ask for the same pass at once."""
    monkeypatch.setattr(work, "_built", None)
    built, both = [], threading.Barrier(2)

    class SlowRecipe:
        provenance: ClassVar = {}

        def build(self, seed):
            time.sleep(0.05)
            built.append(FakePass(seed))
            return built[-1]

    def ask(_):
        both.wait()
        return work.photon_pass(SlowRecipe(), 3)

    with ThreadPoolExecutor(2) as pool:
        asked = list(pool.map(ask, range(2)))
    assert len(built) == 1 and [one.seed for one in asked] == [3, 3]


@pytest.fixture(scope="module")
def local_cluster():
    """Two worker processes of two threads each, which share no folder with the run."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None, silence_logs=50
    ) as made:
        yield made


@pytest.mark.slow
@pytest.mark.kills
def test_a_cluster_makes_the_same_bytes_through_a_workers_death(local_cluster, volume, tmp_path):
    scene = make_scene(SLAB)
    trace(scene, volume, tmp_path / "here", workers=1, progress=False)
    with connect(local_cluster.scheduler_address) as cluster:
        assert cluster.slots == 4
        pids = list(cluster.client.run(os.getpid).values())
        folder = tmp_path / "there"

        def kill_one_midway():
            while len(store.round_files(folder / "rounds")) < 8:
                time.sleep(0.002)
            os.kill(pids[0], signal.SIGKILL)

        killer = threading.Thread(target=kill_one_midway)
        killer.start()
        summary = trace(
            scene, volume, folder, workers=cluster.slots, open_executor=cluster.open_executor, progress=False
        )
        killer.join()
        cluster.client.wait_for_workers(2, timeout=30)
        assert pids[0] not in cluster.client.run(os.getpid).values()
    assert summary.lost == 0
    assert bytes_of(folder) == bytes_of(tmp_path / "here")


@pytest.mark.slow
def test_rounds_that_are_there_are_not_walked_again(local_cluster, volume, tmp_path, monkeypatch):
    scene = make_scene(SLAB | {"photons": {"stored": 1e5}})
    trace(scene, volume, tmp_path / "here", workers=1, progress=False, shard=(0, 2))
    asked = []
    keep = work.WalkRound.keep
    monkeypatch.setattr(
        work.WalkRound, "keep", lambda self, walked: (asked.append(walked.index), keep(self, walked))[1]
    )
    with connect(local_cluster.scheduler_address) as cluster:
        trace(
            scene, volume, tmp_path / "here", workers=2, open_executor=cluster.open_executor, progress=False,
            resume=True
        )
    assert asked and all(index % 2 for index in asked)
    monkeypatch.undo()
    trace(scene, volume, tmp_path / "whole", workers=1, progress=False)
    assert bytes_of(tmp_path / "here") == bytes_of(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.kills
def test_a_lost_scheduler_ends_the_run_and_keeps_what_is_finished(volume, tmp_path):
    """The scheduler is killed, as by a machine that goes down."""
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    contact = tmp_path / "scheduler.json"
    with subprocess.Popen([*command, "--scheduler-file", str(contact)], stderr=subprocess.DEVNULL) as scheduler:
        while not (contact.exists() and contact.stat().st_size):
            time.sleep(0.05)
        address = json.loads(contact.read_text())["address"]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny", "--no-dashboard"]
        with subprocess.Popen([*worker, "--nthreads", "2"], stderr=subprocess.DEVNULL, cwd=tmp_path) as walker:
            while True:
                try:
                    with connect(address) as cluster:
                        _run_until_lost(cluster, scheduler, volume, tmp_path)
                    break
                except InputError:
                    time.sleep(0.2)
            walker.kill()
    assert len(store.round_files(tmp_path / "rounds")) >= 3


def _run_until_lost(cluster, scheduler, volume, folder):
    def kill_midway():
        while len(store.round_files(folder / "rounds")) < 3:
            time.sleep(0.002)
        scheduler.kill()

    killer = threading.Thread(target=kill_midway)
    killer.start()
    with pytest.raises(RunError, match="scheduler was lost.*\n.*--resume"):
        trace(
            make_scene(SLAB), volume, folder, workers=2, open_executor=cluster.open_executor, progress=False
        )
    killer.join()


@pytest.mark.slow
def test_unlike_workers_are_refused_before_the_run(local_cluster, monkeypatch):
    monkeypatch.setattr(cluster_module, "program_identity", lambda: {"walk": "another"})
    identity.cache_clear()
    try:
        with pytest.raises(InputError, match="would make other bytes"), connect(local_cluster.scheduler_address):
            pass
    finally:
        identity.cache_clear()


def test_counts_alone_travel_back_too():
    counts = store.RoundCounts(0, np.ones(1, int), np.zeros(1, int), np.zeros((1, 20), int))
    kept = work.WalkRound(None, 1, np.ones(1), "key", None).keep(counts)
    assert kept.index == 0 and kept.stored == 0


@pytest.mark.kills
@pytest.mark.slow
def test_a_cluster_makes_the_same_picture_through_a_workers_death(local_cluster, tmp_path, monkeypatch):
    skin = {
        "patch": {"size_mm": [2, 2], "columns": [40, 40]}, "bands_nm": {"start": 400, "stop": 700, "step": 20},
        "skin": {"site": "forearm"}, "light": {"kind": "point", "height_mm": 100},
        "camera": {"kind": "orthographic", "pixels": [24, 24]}, "photons": {"stored": 2e6},
    }  # fmt: skip
    monkeypatch.setattr(bands, "PART_PHOTONS", 1)
    scene, path = make_scene(skin), tmp_path / "volume.npz"
    save_volume(build_volume(scene), path)
    trace(scene, path, tmp_path, workers=1, progress=False)
    photon_map = open_map(tmp_path / "photons.npz")
    here, told_here = estimate(scene, load_volume(path), photon_map, progress=False)
    kept, keep = [], bands.ShowBands.keep

    with connect(local_cluster.scheduler_address) as cluster:
        pid = next(iter(cluster.client.run(os.getpid).values()))

        def kill_one_midway(self, light):
            kept.append(int(light.bands[0]))
            if len(kept) == 3:
                os.kill(pid, signal.SIGKILL)
            return keep(self, light)

        monkeypatch.setattr(bands.ShowBands, "keep", kill_one_midway)
        there, told_there = estimate(
            scene, load_volume(path), photon_map, progress=False, cluster=cluster, volume_path=path
        )
        cluster.client.wait_for_workers(2, timeout=30)
        assert pid not in cluster.client.run(os.getpid).values()
    assert sorted(kept) == list(range(16))
    assert np.array_equal(there.radiance, here.radiance) and np.array_equal(there.multiple_Y, here.multiple_Y)
    np.testing.assert_allclose(there.stderr_Y, here.stderr_Y, rtol=1e-4)
    assert told_there.mean_radiance == told_here.mean_radiance
