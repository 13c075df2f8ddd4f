"""Hostile surroundings and inputs of whole commands: one clear message and the right exit code, or they work."""

from __future__ import annotations

import os
import pickle
import resource
import shutil
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from numpy.lib import format as npy

from tests.system.kills import COMMAND, digest, set_stage

SKIN = """\
patch: {size_mm: [4, 4], columns: [8, 8]}
bands_nm: [550]
skin: {site: forearm}
lesions: [{kind: epidermal, pattern: pattern.png}]
"""


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    return set_stage(tmp_path_factory.mktemp("stage"))


def run(*arguments: object, redirect: str = "", **options) -> subprocess.CompletedProcess:
    """The command line in a shell, with a redirection."""
    line = " ".join(f"'{argument}'" for argument in (*COMMAND, *arguments))
    return subprocess.run(["bash", "-c", f"{line} {redirect}"], capture_output=True, text=True, timeout=120, **options)


def said_in_words(stderr: str, *words: str) -> None:
    assert "Traceback" not in stderr and "Warning" not in stderr
    assert all(word in stderr for word in words), stderr


@pytest.mark.parametrize("redirect", [">&-", ">&- 2>&-", ">&- 2>&- <&-"])
def test_closed_streams_do_not_get_into_the_files(stage, tmp_path, redirect):
    assert run("build", stage.scene, "-o", tmp_path, "--json", redirect=redirect).returncode == 0
    assert (tmp_path / "volume.npz").read_bytes() == stage.volume.read_bytes()


@pytest.mark.parametrize("arguments", [["--help"], ["schema"]])
def test_a_full_stdout_is_told(arguments):
    result = run(*arguments, redirect="> /dev/full")
    assert result.returncode == 1
    said_in_words(result.stderr, "No space left")


def test_no_home_no_locale_and_a_path_of_many_letters(stage, tmp_path):
    folder = tmp_path / "a b 'ü' 肌\n"
    folder.mkdir()
    scene = shutil.copy(stage.scene, folder / "szene é.yaml")
    bare = {"PATH": os.environ["PATH"], "PYTHONPATH": os.pathsep.join(sys.path), "LC_ALL": "C"}
    done = subprocess.run(
        [*COMMAND, "build", scene, "-o", folder / "o ut"], capture_output=True, env=bare, timeout=120
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (folder / "o ut" / "volume.npz").exists()


def test_links_lead_to_files_or_are_refused(stage, tmp_path):
    (tmp_path / "link.yaml").symlink_to(stage.scene)
    (tmp_path / "out").symlink_to(tmp_path / "real", target_is_directory=True)
    (tmp_path / "real").mkdir()
    assert call("build", tmp_path / "link.yaml", "-o", tmp_path / "out").exit_code == 0
    assert (tmp_path / "real" / "volume.npz").exists()
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    for name in ("loop.yaml", "pipe.yaml"):
        assert call("build", tmp_path / name).exit_code == 2


BILLION = """\
patch: {size_mm: [4, 4], columns: [4000, 4000]}
bands_nm: [550]
skin: {site: forearm}
"""


def test_a_billion_voxels_are_refused_with_their_bytes_before_they_are_made(tmp_path, monkeypatch):
    monkeypatch.setattr("skinrender.skin.memory.available_bytes", lambda: 10**9)
    monkeypatch.setattr("numpy.zeros", lambda shape, *a, zeros=np.zeros, **k: zeros(small(shape), *a, **k))
    (tmp_path / "s.yaml").write_text(BILLION)
    result = call("build", tmp_path / "s.yaml", "-o", tmp_path)
    assert result.exit_code == 2
    said_in_words(result.stderr, "GB of memory, 1.0 GB are free")


def small(shape) -> object:
    assert np.prod(shape) < 10**8, "allocated"
    return shape


BOMBS = {
    "aliases": "a: &a [x, x, x, x, x, x, x, x, x]\n"
    + "".join(f"{b}: &{b} [{', '.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi")),
    "tag": "patch: !!python/object/apply:os.system [touch owned]\n",
    "nesting": "patch: " + "[" * 5000,
    "merge": "<<: &a {<<: *a}\n",
}


@pytest.mark.parametrize("name", BOMBS)
def test_hostile_scenes_end_with_2_and_a_place(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(BOMBS[name])
    result = call("build", "s.yaml")
    assert result.exit_code == 2 and "s.yaml:" in result.stderr
    assert not Path("owned").exists()


class Owned:
    """What must never be unpickled."""

    def __reduce__(self):
        return os.system, ("touch owned",)


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("kind", ["pickle", "bomb"])
def test_pickles_and_zip_bombs_in_a_map_are_refused(stage, tmp_path, monkeypatch, kind, compression):
    monkeypatch.chdir(tmp_path)
    stage.begin(tmp_path / "out")
    with zipfile.ZipFile("out/photons.npz", "w", compression) as archive, archive.open("position.npy", "w") as member:
        shape = (1,) if kind == "pickle" else (10**9, 3)
        npy.write_array_header_1_0(member, {"descr": "|O" if kind == "pickle" else "<f4", "fortran_order": False, "shape": shape})
        member.write(pickle.dumps(Owned()) if kind == "pickle" else bytes(10**6))
    result = call("estimate", stage.scene, "-o", "out")
    assert result.exit_code == 2 and "photons.npz" in result.stderr
    assert not Path("owned").exists()


def png(width: int, height: int, *chunks: tuple[bytes, bytes]) -> bytes:
    """A gray PNG of that size with further chunks and a black line or two."""
    header = (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    content = b"\x89PNG\r\n\x1a\n"
    for kind, body in (header, *chunks, (b"IDAT", zlib.compress(bytes(10**6))), (b"IEND", b"")):
        content += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return content


@pytest.mark.parametrize(
    "image",
    [
        png(2**31 - 1, 2**31 - 1),
        png(40_000, 40_000),
        png(10_000, 8000),
        png(8, 8, (b"zTXt", b"x\0\0" + zlib.compress(bytes(10**8)))),
        b"",
    ],
)
def test_image_bombs_are_refused_without_taking_memory(tmp_path, image):
    (tmp_path / "s.yaml").write_text(SKIN)
    (tmp_path / "pattern.png").write_bytes(image)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = call("build", tmp_path / "s.yaml", "-o", tmp_path)
    assert result.exit_code == 2 and "pattern.png: " in result.stderr
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize(
    ("value", "place"),
    [("{kind: point, height_mm: 1e-30}", "height_mm"), ("{kind: collimated, irradiance_W_per_mm2: 1e300}", "irradiance")],
)
def test_lights_that_numbers_cannot_hold_are_refused(stage, tmp_path, value, place):
    text = stage.scene.read_text().replace("{kind: collimated}", value)
    (tmp_path / "s.yaml").write_text(text)
    result = call("build", tmp_path / "s.yaml", "-o", tmp_path)
    assert result.exit_code == 2 and place in result.stderr


def test_a_spectrum_without_end_is_refused(stage, tmp_path):
    with open(tmp_path / "light.csv", "wb") as file:
        file.truncate(10**10)
    (tmp_path / "s.yaml").write_text(stage.scene.read_text().replace("collimated", "collimated, spectrum: light.csv"))
    result = call("render", tmp_path / "s.yaml", "-o", tmp_path)
    assert result.exit_code == 2 and "larger than" in result.stderr


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 2 MB, where mounting is allowed."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", folder], capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    yield folder
    subprocess.run(["umount", folder], check=True)


BLIND = "import shutil, types; shutil.disk_usage = lambda _: types.SimpleNamespace(free=1e15); from skinrender.cli import main; main()"


def test_a_full_disk_keeps_the_rounds_and_a_larger_one_goes_on(stage, small_disk):
    (small_disk / "volume.npz").write_bytes(stage.volume.read_bytes())
    options = ["trace", stage.scene, "-o", small_disk, "-q"]
    foreseen = run(*options)
    assert foreseen.returncode == 1
    said_in_words(foreseen.stderr, "the disk has")
    met = subprocess.run([sys.executable, "-c", BLIND, *options], capture_output=True, text=True, timeout=120)
    assert met.returncode == 1
    said_in_words(met.stderr, "No space left on device", "--resume")
    assert met.stderr.count("--resume") == 1 and list((small_disk / "rounds").glob("round-*"))
    assert not list((small_disk / "rounds").glob(".*")) and not list(small_disk.glob(".*"))
    subprocess.run(["mount", "-o", "remount,size=200m", small_disk], check=True)
    assert run(*options, "--resume").returncode == 0
    assert digest(small_disk / "photons.npz") == stage.expected


def test_a_read_only_disk_is_told(stage, small_disk):
    (small_disk / "volume.npz").write_bytes(stage.volume.read_bytes())
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    for command in ("build", "trace"):
        result = run(command, stage.scene, "-o", small_disk)
        assert result.returncode == 1
        said_in_words(result.stderr, "Read-only file system", str(small_disk))


def test_a_limit_on_file_size_keeps_the_older_file(stage, tmp_path):
    stage.begin(tmp_path / "out")
    before = (tmp_path / "out" / "volume.npz").read_bytes()
    result = run("build", stage.scene, "-o", tmp_path / "out", preexec_fn=limit_files)
    assert result.returncode == 1
    said_in_words(result.stderr, "volume.npz: cannot be written (File too large)")
    assert (tmp_path / "out" / "volume.npz").read_bytes() == before
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["volume.npz"]


def limit_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
