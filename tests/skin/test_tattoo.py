"""Tattoos: ink by depth to the voxel, coefficients, palette and file."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from skinrender.errors import InputError
from skinrender.npz import read_npz, write_npz
from skinrender.optics.inks import ink_absorption
from skinrender.scene import make_scene
from skinrender.skin.anatomy import skin_layers
from skinrender.skin.builder import build_volume
from skinrender.skin.dermis import range_of_layers_mm
from skinrender.skin.section import darkest_row, draw_section
from skinrender.skin.tattoo import add_ink
from skinrender.skin.volume import load_volume, save_volume

NAMES = ["basal", "papillary", "papillary", "reticular", "lower_plexus", "subcutis"]
HEIGHT_MM = np.array([0.01, 0.05, 0.05, 0.2, 0.1, 3.0])
FLAT = {"relief": {"kind": "flat"}, "skin": {"border_wave": {"peak_to_valley_um": 0}}}
NM = [450.0, 550.0, 650.0]


def _inked(p, depth_mm, own=0.0):
    return add_ink(np.full((len(p), len(NAMES)), own), NAMES, HEIGHT_MM, np.array(p), depth_mm)


def test_voxel_layers_hold_ink_by_the_part_of_their_height():
    # 0.075 to 0.2 mm: half of the second papillary voxel layer, half of the reticular one
    ink, lowest = _inked([0.04, 0.0, 0.02], (0.075, 0.2))
    assert np.allclose(ink, np.outer([0.04, 0, 0.02], [0, 0, 0.5, 0.5, 0, 0]), atol=1e-15) and lowest == 3
    assert np.allclose(ink @ HEIGHT_MM, np.array([0.04, 0, 0.02]) * 0.125)


def test_pattern_0_leaves_columns_as_they_are():
    ink, lowest = _inked([0.0, 0.0], (0.0, 0.3), own=0.1)
    assert np.all(ink == 0.1) and lowest == -1


def test_stays_in_the_dermis_and_below_1():
    ink, lowest = _inked([0.8], (0.0, 0.4), own=0.5)
    assert ink.tolist() == [[0.5, 1, 1, 1, 1, 0.5]] and lowest == 4


def test_range_of_voxel_layers():
    layers = skin_layers("forearm", {})
    # 20 reticular voxel layers of 50 um lie below 0.26 mm: the fifth from below has its middle at 1.035 mm
    assert range_of_layers_mm(layers, 5, 1) == pytest.approx((0.96, 1.11))
    assert range_of_layers_mm(layers, 46, 3) == pytest.approx((0.0, 0.04))
    assert range_of_layers_mm(layers, 1, 100) == pytest.approx((0.0, 1.36))
    with pytest.raises(InputError, match="Use 1 to 46"):
        range_of_layers_mm(layers, 47, 1)


@pytest.fixture
def stripes(tmp_path):
    """Columns ix hold the gray level 255 - ix: darkness ix / 255; the first one is white."""
    gray = np.repeat(255 - np.arange(256, dtype=np.uint8)[None], 4, axis=0)
    Image.fromarray(gray).save(tmp_path / "stripes.png")
    Image.fromarray(gray[:, ::-1].copy()).save(tmp_path / "reversed.png")
    return tmp_path


def scene(folder, *lesions, **keys):
    data = {"patch": {"size_mm": [8, 0.125], "columns": [256, 4]}, "bands_nm": NM, **FLAT, "lesions": list(lesions)}
    return make_scene(data | keys, source_dir=folder)


def tattoo(**keys):
    return {"kind": "tattoo", "pattern": "stripes.png", "volume_fraction": 0.02, "depth_mm": [0.26, 0.56], **keys}


def test_coefficients_are_tissue_and_fraction_times_ink(stripes):
    plain, inked = build_volume(scene(stripes)), build_volume(scene(stripes, tattoo(ink="blue")))
    tissue = np.array([plain.mu_a[np.flatnonzero(plain.palette_layer == layer)[0]] for layer in inked.palette_layer])
    added = inked.palette_ink * ink_absorption("blue", np.array(NM))
    assert np.allclose(inked.mu_a, tissue + added, rtol=1e-6) and inked.ink_name == ("blue",)
    reticular = inked.layer_name.index("reticular")
    held = inked.palette_layer[inked.palette_ink[:, 0] > 0]
    assert held.size == 255 and np.all(held == reticular)
    for name in ("mu_s", "g"):
        one = np.array([getattr(plain, name)[plain.palette_layer == layer][0] for layer in inked.palette_layer])
        assert np.array_equal(getattr(inked, name), one)


def test_columns_hold_the_ink_of_their_gray_level(stripes):
    volume = build_volume(scene(stripes, tattoo()))
    ink = volume.palette_ink[volume.palette_index, 0]
    depth = 0.5 * (volume.z_edges_mm[1:] + volume.z_edges_mm[:-1])
    inside = (depth > 0.075 + 0.26) & (depth < 0.075 + 0.56)
    expected = 0.02 * np.arange(256) / 255
    assert inside.sum() == 6 and np.allclose(ink[:, 0, inside], expected[:, None], atol=1e-8)
    assert not ink[:, :, ~inside].any() and not ink[0].any()
    # each layer below the ink is one voxel layer
    below = volume.palette_layer[volume.palette_index[0, 0, depth > 0.635]]
    assert [volume.layer_name[i] for i in below] == ["reticular", "lower_plexus", "subcutis"]


def test_palette_of_tattoos_of_two_inks_over_a_mole(stripes):
    mole = {"kind": "mole", "pattern": "reversed.png", "melanin_scale": 0.3, "depth_mm": 0.4}
    lesions = (mole, tattoo(ink="red"), tattoo(ink="green", pattern="reversed.png"), tattoo(ink="red"))
    volume = build_volume(scene(stripes, *lesions))
    assert volume.ink_name == ("red", "green") and volume.palette_ink.shape[1] == 2
    contents = np.column_stack([volume.palette_layer, volume.palette_melanin, volume.palette_ink])
    assert len(np.unique(contents, axis=0)) == len(contents) < 1 << 16
    assert np.array_equal(np.unique(volume.palette_index), np.arange(1, len(contents)))
    assert volume.palette_ink.max(axis=0) == pytest.approx([0.04, 0.02]) and not volume.palette_ink[0].any()


def test_without_a_tattoo_there_is_no_ink(stripes, tmp_path):
    volume = build_volume(scene(stripes, {"kind": "epidermal", "pattern": "stripes.png"}))
    save_volume(volume, tmp_path / "volume.npz")
    assert volume.palette_ink is None and not {"palette_ink", "ink_name"} & set(read_npz(tmp_path / "volume.npz"))


def test_white_tattoo_changes_no_coefficient(stripes):
    Image.fromarray(np.full((4, 256), 255, np.uint8)).save(stripes / "white.png")
    plain, white = build_volume(scene(stripes)), build_volume(scene(stripes, tattoo(pattern="white.png")))
    assert np.array_equal(plain.mu_a, white.mu_a) and np.array_equal(plain.palette_index, white.palette_index)
    assert not white.palette_ink.any()


def test_folded_volume_keeps_the_ink(stripes):
    """Below the fold to rounding; within it the tissue, ink and all, is stretched here and pressed there."""
    expected = 0.02 * np.arange(256)[:, None] / 255
    folded = {"relief": {"kind": "procedural"}, "skin": {}}
    for depth_mm, tolerance in (([0.26, 0.56], 1e-6), ([0.1, 0.3], 0.2)):
        volume = build_volume(scene(stripes, tattoo(depth_mm=depth_mm), **folded))
        ink = volume.palette_ink[volume.palette_index, 0] @ np.diff(volume.z_edges_mm)
        height_mm = depth_mm[1] - depth_mm[0]
        assert np.allclose(ink, height_mm * expected, rtol=tolerance, atol=1e-12)
        assert ink.sum() == pytest.approx(4 * height_mm * expected.sum(), rel=0.02)


def test_file_round_trip_and_its_checks(stripes, tmp_path):
    volume, file = build_volume(scene(stripes, tattoo(ink="green"))), tmp_path / "volume.npz"
    save_volume(volume, file)
    loaded = load_volume(file)
    assert np.array_equal(loaded.palette_ink, volume.palette_ink) and loaded.ink_name == ("green",)
    members = dict(read_npz(file))
    write_npz(file, members | {"palette_ink": members["palette_ink"] + np.float32(2)})
    with pytest.raises(InputError, match="palette_ink holds impossible values"):
        load_volume(file)
    del members["ink_name"]
    write_npz(file, members)
    with pytest.raises(InputError, match="ink_name is missing"):
        load_volume(file)


def test_section_shows_the_row_with_the_most_ink(stripes, tmp_path):
    gray = np.full((4, 256), 255, np.uint8)
    gray[3, 200] = 0
    Image.fromarray(gray).save(stripes / "dot.png")
    inked = build_volume(scene(stripes, tattoo(pattern="dot.png")))
    assert darkest_row(inked) == 3 and darkest_row(build_volume(scene(stripes))) == 2
    for name, volume in (("inked", inked), ("plain", build_volume(scene(stripes)))):
        draw_section(volume, tmp_path / f"{name}.png")
    assert (tmp_path / "inked.png").read_bytes() != (tmp_path / "plain.png").read_bytes()


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"ink": "bleu"}, r"lesions\.0\.ink: got 'bleu'; allowed: 'carbon_black', 'red', 'blue', 'green' or a .csv file"),
        ({"ink": "mine.csv"}, r"lesions\.0\.ink: got 'mine.csv'; there is no such file"),
        ({"depth_mm": [0.5, 0.2]}, r"lesions\.0\.depth_mm: got \[0.5, 0.2\]; the upper depth comes first"),
        ({"depth_mm": None}, r"lesions\.0: a tattoo needs either depth_mm, or center_layer and half_layers"),
        ({"center_layer": 3}, r"lesions\.0: a tattoo needs either depth_mm, or center_layer and half_layers"),
        ({"depth_mm": [0.2, 2]}, "depth_mm 2 lies below the dermis\n  Use at most 1.36"),
    ],
)
def test_mistakes(stripes, keys, told):
    with pytest.raises(InputError, match=told):
        build_volume(scene(stripes, tattoo(**keys)))


def test_a_users_ink_is_part_of_the_scenes_hash(stripes):
    (stripes / "mine.csv").write_text("wavelength_nm,mu_a_per_mm\n380,100\n780,900\n")
    volume = build_volume(scene(stripes, tattoo(ink="mine.csv")))
    black = np.argmax(volume.palette_ink[:, 0])
    plain = np.flatnonzero((volume.palette_layer == volume.palette_layer[black]) & (volume.palette_ink[:, 0] == 0))[0]
    assert np.allclose(volume.mu_a[black] - volume.mu_a[plain], 0.02 * (100 + 2 * (np.array(NM) - 380)), rtol=1e-5)
    before = volume.provenance["hash"]
    (stripes / "mine.csv").write_text("380,200\n780,900\n")
    assert build_volume(scene(stripes, tattoo(ink="mine.csv"))).provenance["hash"] != before
