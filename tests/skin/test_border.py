"""Borders: thickness kept under the fold, fading below, papillae without stripes."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.skin import border, spline
from skinrender.skin.anatomy import LayerSpec, border_depths, skin_layers
from skinrender.skin.heights import Heights

LAYERS = skin_layers("forearm", {})
SIZE = (2.0, 2.0)


def _fields(surface_mm, wave_mm):
    surface = np.full((4, 4), surface_mm, np.float32)
    wave = np.full((4, 4), wave_mm, np.float32)
    heights = Heights(surface, wave, border.fold(LAYERS, 0.1))
    return {
        layer.name: float(heights.at(z)[0, 0])
        for layer, z in zip(LAYERS, border_depths([layer.thickness_mm for layer in LAYERS])[1:])
    }


def test_epidermis_keeps_its_thickness_under_the_relief():
    z = _fields(0.06, 0.0)
    assert np.allclose([z["stratum_corneum"], z["granular_spinous"], z["basal"]], [0.08, 0.125, 0.135])


def test_epidermis_keeps_its_thickness_along_the_normal():
    """Every point of a border is as far from the surface as its layer is thick: on walls, at bottoms and at
    shoulders."""
    furrow = 0.05 * np.clip(1 - np.abs(np.arange(-40, 40) / 80) / 0.0625, 0, 1)
    surface = spline.control_points(np.repeat(furrow[:, None], 8, axis=1))
    center = (np.arange(80) + 0.5) / 80
    fine = np.linspace(0, 1, 8000, endpoint=False)
    height = spline.evaluate_grid(surface, (1.0, 0.1), fine, np.array([0.05]))[:, 0]
    for distance in (0.02, 0.075):
        below = border.offset_mm(surface, (1.0, 0.1), distance)[:, 4]
        nearest = np.sqrt((fine - center[:, None]) ** 2 + (height - below[:, None]) ** 2).min(axis=1)
        assert np.allclose(nearest[10:70], distance, rtol=0.025)
        vertical = below - np.interp(center, fine, height)
        assert vertical.max() > 1.2 * distance and vertical[15] == pytest.approx(distance)


def test_offset_is_the_largest_of_the_surface_moved_over_a_ball():
    """Against the spline evaluated at the moved places, on unlike sides and further than the patch is wide."""
    surface = np.random.default_rng(5).standard_normal((12, 9)).astype(np.float32) * 0.05
    size = (1.0, 0.6)
    x, y = ((np.arange(count) + 0.5) * (length / count) for count, length in zip(surface.shape, size))
    for distance in (0.02, 0.9):
        steepest = border._steepest(surface, size)
        rings = int(np.ceil(steepest / border._RING))
        expected = spline.evaluate_grid(surface, size, x, y) + distance
        for tilt in steepest * np.arange(1, rings + 1) / rings:
            for angle in 2 * np.pi * np.arange(12) / 12:
                dx, dy = distance * np.sin(tilt) * np.cos(angle), distance * np.sin(tilt) * np.sin(angle)
                beside = spline.evaluate_grid(surface, size, x + dx, y + dy)
                expected = np.maximum(expected, beside + distance * np.cos(tilt))
        assert border.offset_mm(surface, size, distance) == pytest.approx(expected, abs=1e-12)


def test_thickening_leaves_level_skin_and_the_bottom_of_the_fold():
    fold = border.fold(LAYERS, 0.1)
    assert not border.thickening_mm(np.full((6, 5), 0.3, np.float32), SIZE, fold).round(7).any()
    rough = np.random.default_rng(3).standard_normal((40, 40)).astype(np.float32) * 0.03
    added = border.thickening_mm(rough, SIZE, fold)
    assert np.all(np.diff(added[:-1], axis=0) >= 0) and not added[0].any() and not added[-1].any()
    assert np.all(rough + added <= rough.max() + 1e-6)


def test_wave_thins_the_spinous_layer_only():
    z = _fields(0.0, -0.02)
    assert np.allclose([z["stratum_corneum"], z["granular_spinous"], z["basal"]], [0.02, 0.045, 0.055])


def test_relief_and_wave_fade_out_by_the_bottom_of_the_subpapillary_layer():
    z = _fields(0.06, 0.02)
    # papillary bottom: 100 of 180 um down the fading stretch, 8/18 of the displacement is left
    assert np.allclose([z["papillary"], z["subpapillary"], z["upper_plexus"]], [0.175 + 0.08 * 8 / 18, 0.255, 0.335])


def test_deep_furrows_fade_over_more_layers():
    assert border.fold(LAYERS, 0.22).bottom_mm == pytest.approx(0.335)
    with pytest.raises(InputError, match="deeper|end at"):
        border.fold(LAYERS, 9.0)


def test_slab_fades_to_its_own_border():
    fold = border.fold([LayerSpec("a", 0.5), LayerSpec("b", 2.0)], 0.1)
    assert fold.bottom_mm == 0.5 and fold.shares(0.25) == (0.5, 0.0)


def test_papillae_stay_within_their_height():
    wave = border.papillae(SIZE, (80, 80), (40, 40), 40, 110)
    x = np.linspace(0, 2, 400, endpoint=False)
    z = spline.evaluate_grid(wave, SIZE, x, x)
    assert np.abs(z).max() <= 0.02 + 1e-12 and 0.007 < z.std() < 0.0105 and abs(z.mean()) < 3e-4


def test_papillae_do_not_alias_into_stripes():
    """Seen by columns of 50 um, all directions and frequencies share the variance; a sine grid puts it in 4 peaks."""
    center = (np.arange(80) + 0.5) * 0.05
    wave = spline.evaluate_grid(border.papillae((4.0, 4.0), (160, 160), (80, 80), 40, 110), (4.0, 4.0), center, center)
    grid = np.outer(np.sin(2 * np.pi * center / 0.11), np.sin(2 * np.pi * center / 0.11))
    peak = [np.sort(np.abs(np.fft.fft2(z)).ravel() ** 2)[-4:].sum() / (z.size * (z**2).sum()) for z in (wave, grid)]
    assert peak[0] < 0.05
    assert peak[1] > 0.3


def test_viable_epidermis_keeps_20_um():
    wave = border.limit_wave(np.linspace(-0.2, 0.2, 9), LAYERS)
    assert wave.min() == pytest.approx(-0.035) and wave.max() == 0.2
