"""A damaged or unwritable cache of kernels costs time only."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skinrender.transport import kernel_cache

MODULE = """
import numba
from skinrender.transport.kernel_cache import cached

@cached(numba.njit(cache=True))
def double(x):
    return 2 * x
"""


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Function that imports a module with one kernel anew, as another process would."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    source = tmp_path / "kernels.py"
    source.write_text(MODULE)

    def load():
        spec = importlib.util.spec_from_file_location("kernels", source)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.double

    return load


def files(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "cache").rglob("*.nb?"))


def hits(kernel) -> int:
    return sum(kernel.stats.cache_hits.values())


def test_a_sound_cache_is_used(fresh):
    assert fresh()(3) == 6
    kernel = fresh()
    assert kernel(3) == 6 and hits(kernel) == 1


@pytest.mark.parametrize("content", [b"", b"\x80", b"garbage" * 100, b"cos\nsystem_that_is_none\n(S'x'\ntR."])
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_a_damaged_cache_is_made_again(fresh, tmp_path, suffix, content):
    fresh()(3)
    for path in files(tmp_path):
        if path.suffix == suffix:
            path.write_bytes(content)
    kernel = fresh()
    assert kernel(3) == 6 and hits(kernel) == 0
    kernel = fresh()
    assert kernel(3) == 6 and hits(kernel) == 1


def test_a_cache_that_cannot_be_written_is_done_without(fresh, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    assert fresh()(3) == 6


def cache_root_of(**environment: str) -> Path:
    told = subprocess.run(
        [sys.executable, "-c", "from skinrender.transport import kernel_cache as k; print(k._cache_root())"],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": os.pathsep.join(sys.path)} | environment,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return Path(told.stdout.strip())


def test_without_a_home_kernels_are_kept_in_the_temporary_folder(tmp_path):
    taken = tmp_path / "file"
    taken.touch()
    folder = cache_root_of(XDG_CACHE_HOME=str(taken), TMPDIR=str(tmp_path))
    assert folder.parent == tmp_path and folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_where_others_may_write_is_not_trusted(tmp_path):
    """Kernels are pickled: whoever can write there can run code here."""
    folder = tmp_path / "skinrender" / kernel_cache._sources_hash()
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    assert cache_root_of(XDG_CACHE_HOME=str(tmp_path), TMPDIR=str(tmp_path)) != folder


def test_a_kernel_kept_under_the_types_of_another_is_made_again(fresh, tmp_path):
    """As two processes can leave it that keep two kernels at once."""
    kernel = fresh()
    kernel(3), kernel(1.5)
    first, second = (path for path in files(tmp_path) if path.suffix == ".nbc")
    first.write_bytes(second.read_bytes())
    kernel = fresh()
    assert kernel(3) == 6 and kernel(1.5) == 3.0
    assert type(kernel(3)) is int and hits(kernel) == 1
