"""Kernels compiled beside the walk are those that the picture needs; who compiles them may fail, and ends with the run."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skinrender.engine import ahead
from skinrender.scene.load import load_scene

ESTIMATE_AFTER = """
import json
import sys
from pathlib import Path

from skinrender.cli import main
from skinrender.engine.ahead import kernels_ahead
from skinrender.engine.estimate import estimate
from skinrender.photonmap.photon_map import open_map
from skinrender.scene.load import load_scene
from skinrender.skin.volume import load_volume
from skinrender.transport.kernel_cache import _KernelCache

path, out = sys.argv[1], Path(sys.argv[2])
for command in ("build", "trace"):
    main([command, path, "-o", str(out), "--quiet"], standalone_mode=False)
scene = load_scene(path)
with kernels_ahead(scene, out / "volume.npz") as compiled:
    status = compiled()
estimate(scene, load_volume(out / "volume.npz"), open_map(out / "photons.npz"), progress=False)
names = [name for name in sys.modules if name.startswith("skinrender.estimate")]
kernels = {value for name in names for value in vars(sys.modules[name]).values() if hasattr(value, "stats")}
kept = [kernel.stats for kernel in kernels if isinstance(kernel._cache, _KernelCache)]
hits, misses = (sum(sum(counts.values()) for counts in each) for each in zip(*((s.cache_hits, s.cache_misses) for s in kept)))
json.dump({"status": status, "hits": hits, "misses": misses}, sys.stdout)
"""

PATIENCE_S = 20.0


@pytest.fixture
def scene(repository, monkeypatch):
    monkeypatch.setattr(ahead, "is_on_disk", lambda kernel: False)
    return load_scene(repository / "configs" / "smoke_beam.yaml")


def compile_with(monkeypatch, tmp_path, script: str) -> None:
    """Let a script take the place of the process that compiles."""
    program = tmp_path / "python"
    program.write_text(f"#!{sys.executable}\n{script}\n")
    program.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(program))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["smoke_beam", "smoke_point"])
def test_a_picture_needs_no_kernel_that_was_not_compiled_ahead(repository, tmp_path, name):
    told = subprocess.run(
        [sys.executable, "-c", ESTIMATE_AFTER, str(repository / "configs" / f"{name}.yaml"), str(tmp_path / "out")],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    found = json.loads(told.stdout)
    assert found["status"] == 0 and found["misses"] == 0 and found["hits"] > 5


def test_a_process_that_fails_costs_nothing(scene, tmp_path, monkeypatch):
    compile_with(monkeypatch, tmp_path, "raise SystemExit(3)")
    with ahead.kernels_ahead(scene, tmp_path / "volume.npz") as compiled:
        assert compiled() == 3


def test_a_process_ends_with_the_run_that_started_it(scene, tmp_path, monkeypatch):
    compile_with(monkeypatch, tmp_path, "import os, time\nopen('pid', 'w').write(str(os.getpid()))\ntime.sleep(600)")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt), ahead.kernels_ahead(scene, tmp_path / "volume.npz"):
        until = time.monotonic() + PATIENCE_S
        while not ((tmp_path / "pid").exists() and (tmp_path / "pid").read_text()) and time.monotonic() < until:
            time.sleep(0.01)
        raise KeyboardInterrupt
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


@pytest.mark.parametrize("executable", [None, "", "/nowhere/python"])
def test_without_a_python_to_start_there_is_no_process(scene, tmp_path, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    with ahead.kernels_ahead(scene, tmp_path / "volume.npz") as compiled:
        assert compiled() is None


def test_where_no_kernel_can_be_kept_there_is_no_process(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "none"))
    with ahead.kernels_ahead(scene, tmp_path / "volume.npz") as compiled:
        assert compiled() is None


COMPILE_NOTHING = """
import sys
import time
from skinrender.engine import ahead

class View:
    def __init__(self, scene, *_): self.volume = None
    def prepare(self): print("begun", flush=True); time.sleep({seconds})
    def scattered(self, *_, **__): pass

ahead.View, ahead.load_volume, ahead._map_without_photons = View, lambda path: None, lambda *_: None
ahead._compile()
"""


def compiler(scene, seconds: float) -> subprocess.Popen:
    """A process that compiles nothing for some seconds."""
    script = COMPILE_NOTHING.format(seconds=seconds)
    process = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    process.stdin.write(pickle.dumps((scene, Path("volume.npz"))))
    process.stdin.flush()
    assert process.stdout.readline() == b"begun\n"
    return process


def test_who_compiles_ends_well_while_the_run_goes_on(scene):
    with compiler(scene, 0.0) as process:
        assert process.wait(PATIENCE_S) == 0


def test_who_compiles_ends_when_the_run_is_gone(scene):
    with compiler(scene, 600.0) as process:
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 1


def test_kernels_on_disk_need_no_process(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "is_on_disk", lambda kernel: True)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    with ahead.kernels_ahead(scene, tmp_path / "volume.npz") as compiled:
        assert compiled() is None
