"""A damaged file is refused by name, or read to the same content; never a silently wrong result."""

from __future__ import annotations

import os
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from command_line import call, summary_of

from skinrender.film.exr import read_exr
from skinrender.npz import read_npz, write_npz
from skinrender.photonmap.photon_map import open_map
from skinrender.photonmap.store import read_header, read_round, round_path
from skinrender.skin.volume import load_volume
from tests.system.damage import damaged, outcomes

MANY = int(os.environ.get("SKINRENDER_DAMAGES", "60"))
SCENE = """\
patch: {size_mm: [1, 1], columns: [2, 2]}
bands_nm: [450, 550]
slab:
  layers:
    - {thickness_mm: 1, mu_a_per_mm: 1, mu_s_per_mm: 5, g: 0.5, refractive_index: 1.4}
light: {kind: collimated}
camera: {pixels: [6, 4]}
photons: {stored: 2e3}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with every kind of file: volume, map, picture, and the rounds of a shard."""
    folder = tmp_path_factory.mktemp("made")
    scene = folder / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    for command in (["render"], ["trace", "--shard", "0/3"]):
        result = call(*command, scene, "-o", folder, "-q")
        assert result.exit_code == 0, result.stderr
    return folder


def same_fields(a, b) -> bool:
    return type(a) is type(b) and all(
        np.array_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a)
    )


def a_round(folder: Path):
    key = read_header(folder / "rounds" / "run.npz").key
    return round_path(folder / "rounds", 3), lambda path: vars(read_round(path, key, verify=True)) | read_npz(path)


def same_members(a, b) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def kinds(folder: Path):
    return {
        "volume": (folder / "volume.npz", load_volume, same_fields),
        "photon map": (folder / "photons.npz", lambda path: open_map(path, check_photons=True), same_fields),
        "round": (*a_round(folder), same_members),
        "picture": (folder / "beam.exr", read_exr, same_fields),
    }


@pytest.mark.parametrize("kind", ["volume", "photon map", "round", "picture"])
def test_cut_anywhere_or_with_bits_flipped(made, kind):
    path, read, same = kinds(made)[kind]
    count = outcomes(path, read, same, damaged(path.read_bytes(), MANY, MANY, 7))
    assert count["refused"] >= MANY


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["volume", "photon map", "round", "picture"])
def test_many_damages(made, kind):
    path, read, same = kinds(made)[kind]
    outcomes(path, read, same, damaged(path.read_bytes(), 50 * MANY, 50 * MANY, 8))


@pytest.fixture
def folder(made, tmp_path) -> Path:
    """A copy of the folder, to be changed."""
    return shutil.copytree(made, tmp_path / "copy")


def rewrite(path: Path, **changes: np.ndarray) -> None:
    """Change members of a file, whose checksums then fit."""
    members = {name: np.array(array) for name, array in read_npz(path, mmap=False).items()}
    write_npz(path, members | {name: change(members[name]) for name, change in changes.items()})


def first_is(value):
    def change(array: np.ndarray) -> np.ndarray:
        array.reshape(-1)[0] = value
        return array

    return change


@pytest.mark.parametrize(
    ("name", "member", "change"),
    [
        ("photons.npz", "position", first_is(np.nan)),
        ("photons.npz", "position", first_is(-5.0)),
        ("photons.npz", "power_per_band", first_is(np.nan)),
        ("photons.npz", "format_version", lambda version: version + 1),
        ("volume.npz", "mu_a", first_is(np.nan)),
        ("volume.npz", "format_version", lambda version: version + 1),
    ],
)
def test_what_cannot_be_is_refused_by_the_estimate_and_made_again_by_render(made, folder, name, member, change):
    rewrite(folder / name, **{member: change})
    result = call("estimate", folder / "scene.yaml", "-o", folder)
    assert result.exit_code == 2
    assert str(folder / name) in result.stderr and "skinrender " in result.stderr
    summary_of(call("render", folder / "scene.yaml", "-o", folder, "--json"))
    assert (folder / name).read_bytes() == (made / name).read_bytes()


@pytest.mark.parametrize("name", ["volume.npz", "photons.npz"])
def test_a_flipped_bit_ends_the_estimate_with_2(folder, name):
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    result = call("estimate", folder / "scene.yaml", "-o", folder)
    assert result.exit_code == 2 and str(folder / name) in result.stderr


def test_large_maps_are_verified_too(folder, monkeypatch):
    monkeypatch.setattr("skinrender.npz.VERIFY_BELOW", 0)
    test_a_flipped_bit_ends_the_estimate_with_2(folder, "photons.npz")


def test_a_flipped_pixel_is_rendered_again(made, folder):
    content = bytearray((folder / "beam.exr").read_bytes())
    content[-200] ^= 1
    (folder / "beam.exr").write_bytes(content)
    summary = summary_of(call("render", folder / "scene.yaml", "-o", folder, "--json"))
    assert summary["stages_run"] == ["estimate"]
    assert np.array_equal(read_exr(folder / "beam.exr").radiance, read_exr(made / "beam.exr").radiance)


def test_a_round_under_the_name_of_another_is_walked_again(made, folder):
    rounds = folder / "rounds"
    shutil.copy(round_path(rounds, 3), round_path(rounds, 0))
    (folder / "photons.npz").unlink()
    assert call("trace", folder / "scene.yaml", "-o", folder, "--resume").exit_code == 0
    assert (folder / "photons.npz").read_bytes() == (made / "photons.npz").read_bytes()


def test_times_of_files_decide_nothing(folder):
    """A clock that went back leaves files of the future."""
    for path in folder.iterdir():
        os.utime(path, (2**32, 2**32) if path.name == "photons.npz" else (0, 0))
    assert summary_of(call("render", folder / "scene.yaml", "-o", folder, "--json"))["stages_run"] == []


def test_a_map_of_another_scene_is_refused(folder, tmp_path):
    other = tmp_path / "other.yaml"
    other.write_text(SCENE.replace("mu_a_per_mm: 1", "mu_a_per_mm: 2"), encoding="utf-8")
    assert call("build", other, "-o", folder, "-q").exit_code == 0
    result = call("estimate", other, "-o", folder)
    assert result.exit_code == 2
    assert "was traced for another scene; it differs in: volume" in result.stderr


