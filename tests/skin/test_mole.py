"""Moles, column by column, against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from skinrender.errors import InputError
from skinrender.scene import make_scene
from skinrender.skin.anatomy import skin_layers
from skinrender.skin.builder import build_volume
from skinrender.skin.dermis import depth_of_layers_mm
from skinrender.skin.macule import darken_epidermis
from skinrender.skin.mole import Nests, add_nests
from skinrender.skin.stack import voxel_stack

# Two papillary voxel layers of 50 um, one subpapillary of 100, two reticular of 200, one lower plexus of 100.
NAMES = ["basal", "papillary", "papillary", "subpapillary", "reticular", "reticular", "lower_plexus", "subcutis"]
HEIGHT_MM = np.array([0.01, 0.05, 0.05, 0.1, 0.2, 0.2, 0.1, 3.0])
FLAT = {"relief": {"kind": "flat"}, "skin": {"border_wave": {"peak_to_valley_um": 0}}}


def _nests(p, depth_mm=0.5, share=0.5, own=0.0):
    return add_nests(np.full((len(p), len(NAMES)), own), NAMES, HEIGHT_MM, np.array(p), depth_mm, share)


def test_0_percent_is_untouched():
    melanin, lowest = _nests([0.0, 0.4], own=0.05)
    assert np.all(melanin[0] == 0.05) and lowest == 4
    melanin, lowest = _nests([0.0])
    assert not melanin.any() and lowest == -1


def test_black_reaches_the_depth_and_thins_with_it():
    # middles at 0.025, 0.075, 0.15, 0.3, 0.5 (not above the depth), 0.65; share p = 0.4
    melanin, lowest = _nests([0.8])
    expected = 0.4 * (1 - np.array([0.025, 0.075, 0.15, 0.3]) / 0.5)
    assert np.abs(melanin[0, 1:5] - expected).max() <= 0.5 * 0.4 / 255 + 1e-12
    assert not melanin[0, 0] and not melanin[0, 5:].any() and lowest == 4


def test_half_as_dark_reaches_half_as_deep():
    # d = 0.25: middles 0.025, 0.075, 0.15 lie above; share p = 0.2
    melanin, lowest = _nests([0.8, 0.4])
    expected = 0.2 * (1 - np.array([0.025, 0.075, 0.15]) / 0.25)
    assert np.abs(melanin[1, 1:4] - expected).max() <= 0.5 * 0.4 / 255 + 1e-12
    assert not melanin[1, 4:].any() and lowest == 4


def test_stays_within_the_dermis_and_below_1():
    melanin, lowest = _nests([1.0], depth_mm=100.0, share=1.0, own=0.5)
    assert melanin[0].tolist() == [0.5] + 6 * [1.0] + [0.5] and lowest == 6


def test_added_melanin_is_as_fine_as_the_pattern_and_no_finer():
    rng = np.random.default_rng(1)
    melanin, _ = _nests(0.6 * np.sort(rng.integers(0, 256, 300)) / 255, share=0.25)
    levels = melanin / (0.25 * 0.6 / 255)
    assert np.abs(levels - np.round(levels)).max() < 1e-9 and len(np.unique(np.round(levels))) <= 256


def test_depth_of_voxel_layers():
    layers = skin_layers("forearm", {})
    assert depth_of_layers_mm(layers, 3) == pytest.approx(0.03)
    assert depth_of_layers_mm(layers, 10 + 8 + 8) == pytest.approx(0.26)
    assert depth_of_layers_mm(layers, 48) == pytest.approx(1.36)
    with pytest.raises(InputError, match="Use 1 to 48"):
        depth_of_layers_mm(layers, 49)


def test_forearm_stack_is_macule_above_and_nests_below():
    layers = skin_layers("forearm", {})
    p = np.array([[0.0, 0.2], [0.4, 0.0]])
    stack = voxel_stack(layers, (2, 2), [p], [Nests(p, 0.1, 0.3)])
    black = stack.melanin[stack.column_class[1, 0]]
    names = [layers[i].name for i in stack.layer]
    own = np.repeat([layer.tissue.melanosome for layer in layers], [layer.voxel_layers for layer in layers])
    every = [layer.name for layer in layers for _ in range(layer.voxel_layers)]
    macule = darken_epidermis(own[None], every, np.array([0.4]))[0]
    assert np.allclose(black[:15], macule[:15], atol=1e-7)
    # ten papillary voxel layers of 10 um, their middles at 5, 15, ... um
    expected = 0.3 * 0.4 * (1 - (np.arange(10) + 0.5) / 10)
    papillary = black[15:25]
    assert names[15:25] == 10 * ["papillary"] and np.abs(papillary - expected).max() < 0.5 * 0.12 / 255 + 1e-7
    assert not black[25:].any() and names[26:] == ["upper_plexus", "reticular", "lower_plexus", "subcutis"]
    pale = stack.melanin[stack.column_class[0, 0]]
    assert np.array_equal(pale[:15], own[:15].astype(np.float32)) and not pale[15:].any()


@pytest.fixture
def spot(tmp_path):
    gray = np.full((20, 20), 255, np.uint8)
    gray[7, 3] = 0
    Image.fromarray(gray).save(tmp_path / "spot.png")
    return tmp_path


def _volume(folder, **mole):
    lesion = {"kind": "mole", "pattern": "spot.png", "melanin_scale": 0.4, **mole}
    data = {"patch": {"size_mm": [2, 2], "columns": [20, 20]}, "bands_nm": [450], **FLAT, "lesions": [lesion]}
    return build_volume(make_scene(data, source_dir=folder))


def test_volume_of_a_mole_by_depth_and_by_voxel_layers(spot):
    by_depth, by_layers = _volume(spot, depth_mm=0.03, dermal_share=0.5), _volume(spot, depth_layers=3, dermal_share=0.5)
    melanin = by_depth.palette_melanin[by_depth.palette_index]
    assert np.argwhere((melanin != melanin[0, 0]).any(axis=2)).tolist() == [[3, 7]]
    assert np.allclose(melanin[3, 7, 15:18], 0.2 * np.array([5, 3, 1]) / 6, atol=0.2 / 510 + 1e-6)
    assert not melanin[3, 7, 18:].any() and np.allclose(melanin[3, 7, 13:15], 0.51)
    assert np.array_equal(by_depth.palette_index, by_layers.palette_index)
    assert np.array_equal(by_depth.palette_melanin, by_layers.palette_melanin)


def test_mole_deeper_than_the_dermis(spot):
    with pytest.raises(InputError, match="depth_mm 2 lies below the dermis") as told:
        _volume(spot, depth_mm=2)
    assert "Use at most 1.36" in str(told.value)


@pytest.mark.parametrize("depth", [{}, {"depth_mm": 0.2, "depth_layers": 3}])
def test_depth_is_given_once(spot, depth):
    with pytest.raises(InputError, match=r"lesions\.0: a mole needs either depth_mm or depth_layers"):
        _volume(spot, **depth)
