"""The volume's file: read back as it was, refused when its parts do not fit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.npz import read_npz, write_npz
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.section import darkest_row, draw_section
from skinrender.skin.volume import load_volume, save_volume


@pytest.fixture(scope="module")
def volume():
    data = {"patch": {"size_mm": [1, 1.5], "columns": [10, 15]}, "bands_nm": [450, 650], "skin": {}}
    return build_volume(make_scene(data))


@pytest.fixture
def file(volume, tmp_path):
    save_volume(volume, tmp_path / "volume.npz")
    return tmp_path / "volume.npz"


def test_what_each_plane_holds(volume):
    for k, held in enumerate(volume.plane_holds):
        assert set(np.flatnonzero(held)) == set(volume.palette_index[:, :, k].ravel())
    for k, held in enumerate(volume.plane_holds_tissue):
        assert set(np.flatnonzero(held)) == set(volume.tissue_index[:, :, k].ravel())


def test_round_trip(volume, file):
    loaded = load_volume(file)
    for field in dataclasses.fields(volume):
        before, after = getattr(volume, field.name), getattr(loaded, field.name)
        if isinstance(before, np.ndarray):
            assert np.array_equal(before, after) and before.dtype == after.dtype
        else:
            assert before == after


def test_contract_names(file):
    with np.load(file) as members:
        assert members["format_version"] == 1 and members["palette_index"].dtype == np.uint16
        assert members["bounds_mm"].shape == (2, 3) and members["bounds_mm"][1, 0] == 1


def test_same_scene_same_bytes(volume, file, tmp_path):
    save_volume(load_volume(file), tmp_path / "again.npz")
    assert file.read_bytes() == (tmp_path / "again.npz").read_bytes()


def test_air_is_filled_with_the_tissue_below(volume):
    index = np.array([[[0, 0, 1, 2], [3, 1, 1, 2]], [[0, 1, 2, 2], [0, 0, 0, 3]]], np.uint16)
    cut = dataclasses.replace(volume, palette_index=index, palette_layer=np.array([0, 1, 2, 3], np.uint8))
    assert cut.tissue_index.tolist() == [[[1, 1, 1, 2], [3, 1, 1, 2]], [[1, 1, 2, 2], [3, 3, 3, 3]]]
    assert cut.palette_index[0, 0, 0] == 0
    full = dataclasses.replace(cut, palette_index=cut.tissue_index)
    assert np.array_equal(full.tissue_index, cut.tissue_index)


def _replaced(file, **changes):
    members = dict(read_npz(file)) | changes
    write_npz(file, {k: v for k, v in members.items() if v is not None})


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("palette_index", lambda a: a.astype("u4")),
        ("palette_index", lambda a: a + np.uint16(1000)),
        ("palette_index", lambda a: a[:, :, :-1]),
        ("z_edges_mm", lambda a: a[::-1]),
        ("z_edges_mm", lambda a: np.where(np.arange(a.size) == 1, np.nan, a)),
        ("mu_a", lambda a: -a),
        ("mu_s", lambda a: a[:, :1]),
        ("g", lambda a: a + 1),
        ("palette_layer", lambda a: a + np.uint8(200)),
        ("surface_mm", lambda a: a[:-1]),
        ("surface_mm", lambda a: a * np.float32(np.nan)),
        ("fresnel_borders", lambda a: np.array([8])),
        ("sides", lambda a: np.array("ajar")),
        ("provenance", lambda a: np.array("{")),
        ("format_version", lambda a: np.array(99)),
        ("refractive_index", lambda a: None),
    ],
)
def test_inconsistent_volumes_are_refused(file, name, change):
    _replaced(file, **{name: change(read_npz(file)[name])})
    with pytest.raises(InputError, match=r"volume\.npz.*(shape|values|missing|version|JSON)"):
        load_volume(file)


def test_section_shows_the_darkest_row(volume, tmp_path):
    index = volume.palette_index.copy()
    index[4, 11] = np.argmax(volume.palette_melanin)
    spotted = dataclasses.replace(volume, palette_index=index)
    assert darkest_row(spotted) == 11
    draw_section(spotted, tmp_path / "section.png")
    assert (tmp_path / "section.png").read_bytes().startswith(b"\x89PNG") and len(list(tmp_path.iterdir())) == 1
