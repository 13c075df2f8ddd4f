"""Whole volumes: exact edges where flat, folded columns where not, and refusals before anything is allocated."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from skinrender.errors import InputError
from skinrender.scene import make_scene
from skinrender.skin import memory
from skinrender.skin.builder import build_volume
from skinrender.skin.spline import evaluate_grid

FLAT = {"relief": {"kind": "flat"}, "skin": {"border_wave": {"peak_to_valley_um": 0}}}
SLAB = {"mu_a_per_mm": 1, "mu_s_per_mm": 10, "g": 0.8, "refractive_index": 1.4, "thickness_mm": 1}


def scene(tmp_path=".", size=2.0, columns=20, **keys):
    data = {"patch": {"size_mm": [size, size], "columns": [columns, columns]}, "bands_nm": [450, 650], "skin": {}}
    return make_scene({k: v for k, v in (data | keys).items() if v is not None}, source_dir=tmp_path)


@pytest.fixture
def spot(tmp_path):
    """A 20 x 20 pattern that is 40 % dark in column (ix 3, iy 7) and white elsewhere."""
    gray = np.full((20, 20), 255, np.uint8)
    gray[7, 3] = 153
    Image.fromarray(gray).save(tmp_path / "spot.png")
    return tmp_path


def thickness(volume, name):
    here = volume.palette_layer[volume.palette_index] == volume.layer_name.index(name)
    return (here * np.diff(volume.z_edges_mm)).sum(axis=2)


def test_flat_skin_has_the_edges_of_its_voxel_layers_and_nothing_more():
    volume = build_volume(scene(**FLAT))
    assert volume.shape == (20, 20, 93) and volume.palette_layer.tolist() == list(range(10))
    assert np.allclose(volume.z_edges_mm[:17] * 1e3, np.r_[0:80:5, 85][:17])
    assert set(volume.border_z_mm) <= set(volume.z_edges_mm) and volume.z_edges_mm[0] == 0
    assert (volume.palette_index == volume.palette_index[0, 0]).all() and volume.palette_index.min() == 1
    assert volume.surface_mm is None and volume.border_mm is None and volume.fresnel_borders == ()


def test_air_is_palette_entry_0():
    volume = build_volume(scene(outside={"refractive_index": 1.1}))
    assert volume.layer_name[0] == "air" and volume.palette_layer[0] == 0 and volume.palette_melanin[0] == 0
    assert not (volume.mu_a[0].any() or volume.mu_s[0].any()) and np.all(volume.refractive_index[0] == 1.1)


def test_palette_is_unique_and_used(spot):
    volume = build_volume(scene(spot, lesions=[{"kind": "epidermal", "pattern": "spot.png"}]))
    pairs = set(zip(volume.palette_layer.tolist(), volume.palette_melanin.tolist()))
    assert len(pairs) == volume.palette_layer.size
    assert np.array_equal(np.unique(volume.palette_index), np.arange(len(pairs)))


def test_pattern_pixel_row_column_is_voxel_column_iy_ix(spot):
    volume = build_volume(scene(spot, lesions=[{"kind": "epidermal", "pattern": "spot.png"}], **FLAT))
    melanin = volume.palette_melanin[volume.palette_index].astype(float)
    changed = (melanin != melanin[0, 0]).any(axis=2)
    assert np.argwhere(changed).tolist() == [[3, 7]]
    # own 0.11 + 0.4 = 0.51, m = round(9 * 0.51) = 5, upwards 0.51 + (0.022 - 0.51) j / 6
    column = melanin[3, 7]
    assert np.allclose(column[13:15], 0.51, atol=1e-6) and np.allclose(column[4:8], 0.022)
    assert np.allclose(column[12:7:-1], 0.51 - 0.488 * np.arange(1, 6) / 6, atol=1e-6)


def test_melanin_absorbs_and_leaves_scattering(spot):
    volume = build_volume(scene(spot, lesions=[{"kind": "epidermal", "pattern": "spot.png"}], **FLAT))
    basal = np.flatnonzero(volume.palette_layer == 3)
    assert np.all(np.diff(volume.mu_a[basal], axis=0) > 0) and np.all(np.diff(volume.mu_s[basal], axis=0) == 0)


def test_fold_keeps_epidermal_thickness_column_by_column():
    """Along the normal: vertically it is never less, and as much where the surface is level."""
    volume = build_volume(scene())
    plane = np.diff(volume.z_edges_mm)[0]
    assert plane <= 0.005 + 1e-12
    corneum, basal = thickness(volume, "stratum_corneum"), thickness(volume, "basal")
    assert corneum.min() >= 0.020 - plane - 1e-9 and basal.min() >= 0.010 - plane - 1e-9
    assert abs(np.median(corneum) - 0.020) <= plane and abs(np.median(basal) - 0.010) <= plane
    assert corneum.max() > 0.029
    viable = thickness(volume, "granular_spinous") + basal
    assert viable.min() > 0.020 - plane and 0.055 < viable.mean() < 0.065
    assert np.ptp(thickness(volume, "upper_plexus")) < 1e-12


def test_voxels_are_air_exactly_above_the_surface():
    volume = build_volume(scene())
    x = (np.arange(20) + 0.5) * 0.1
    surface = evaluate_grid(volume.surface_mm, volume.size_mm, x, x)
    centers = 0.5 * (volume.z_edges_mm[1:] + volume.z_edges_mm[:-1])
    assert np.array_equal(volume.palette_index == 0, centers < surface[..., None])
    assert abs(volume.surface_mm.mean()) < 1e-6


def test_borders_never_cross():
    volume = build_volume(scene(skin={"site": "cheek"}))
    assert volume.border_mm.shape == (8, 80, 80)
    assert np.diff(np.concatenate([volume.surface_mm[None], volume.border_mm]), axis=0).min() > 0


def test_wave_alone_has_no_air():
    volume = build_volume(scene(relief={"kind": "flat"}))
    assert volume.z_edges_mm[0] == 0 and volume.surface_mm is None and volume.palette_index.min() == 1
    assert np.ptp(volume.border_mm[0]) == 0 and np.ptp(volume.border_mm[2]) > 0


def test_slab():
    layers = [SLAB, SLAB | {"refractive_index": 1.5, "voxel_layers": 2}, SLAB | {"refractive_index": 1.5}]
    volume = build_volume(scene(skin=None, slab={"layers": layers}))
    assert volume.z_edges_mm.tolist() == [0, 1, 1.5, 2, 3] and volume.fresnel_borders == (0,)
    assert np.all(volume.n_below == 1.5) and np.allclose(volume.mu_s[1:], 10)
    matched = build_volume(scene(skin=None, slab={"layers": layers}, inner_borders="matched"))
    assert matched.fresnel_borders == ()


def test_height_map_of_one_height_is_flat(tmp_path):
    np.save(tmp_path / "map.npy", np.full((5, 5), 7.3))
    relief = {"kind": "height_map", "file": "map.npy", "um_per_unit": 1}
    assert build_volume(scene(tmp_path, **(FLAT | {"relief": relief}))).surface_mm is None


def test_height_map_is_seen_from_above(tmp_path):
    """Row is y, column is x, and a white pixel is a hill: negative z."""
    image = np.zeros((10, 20), np.uint16)
    image[2:4, 14:17] = 65535
    Image.fromarray(image).save(tmp_path / "map.tif")
    relief = {"kind": "height_map", "file": "map.tif", "range_um": [0, 50]}
    surface = build_volume(scene(tmp_path, relief=relief)).surface_mm
    ix, iy = np.unravel_index(np.argmin(surface), surface.shape)
    assert 0.70 <= (ix + 0.5) / 80 <= 0.85 and 0.2 <= (iy + 0.5) / 80 <= 0.4 and -0.06 < surface.min() < -0.045


@pytest.mark.parametrize("array", [
    np.zeros(4), np.full((3, 3), np.nan), np.array([[{}]], object), np.zeros((0, 3)), np.array([[1e308, -1e308]] * 2),
    np.array([[0.0, 2.1e4]]),
])  # fmt: skip
def test_bad_height_maps(tmp_path, array):
    np.save(tmp_path / "map.npy", array)
    with pytest.raises(InputError, match=r"map\.npy"):
        build_volume(scene(tmp_path, relief={"kind": "height_map", "file": "map.npy", "um_per_unit": 1}))


def test_too_large_for_memory_is_refused_with_its_size(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**9)
    with pytest.raises(InputError, match="12.5 GB"):
        build_volume(scene(columns=8192))


def test_a_layer_too_thin_for_its_relief_is_refused():
    """Voxels half as high through the whole fold: half a million planes, minutes of work before the first photon."""
    with pytest.raises(InputError, match=r"0\.001 um thin.*more than 10000"):
        build_volume(scene(skin={"site": "forearm", "layers": {"basal": {"thickness_um": 0.001}}}))


def test_height_field_too_large_for_memory():
    with pytest.raises(InputError, match="height field of 400000 x 400000"):
        build_volume(scene(size=10_000))


def test_one_voxel():
    volume = build_volume(scene(columns=1, skin=None, slab={"layers": [SLAB]}))
    assert volume.shape == (1, 1, 1) and volume.palette_index[0, 0, 0] == 1
