"""Reliefs: periodic, of mean 0, as deep and as wide as asked for."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.skin import relief, spline
from skinrender.skin.aging import YOUNG, Aging, aging

SIZE = (4.0, 3.0)
SAMPLES = relief.default_samples(SIZE)


@pytest.fixture(scope="module", params=["forearm", "cheek"])
def surface(request):
    if request.param == "forearm":
        return relief.furrowed(relief.FOREARM, SIZE, SAMPLES)
    return relief.polygonal(SIZE, SAMPLES)


def test_default_samples_are_25_um():
    assert SAMPLES == (160, 120)


def test_mean_is_zero(surface):
    assert abs(surface.mean()) < 1e-12 and surface.shape == SAMPLES


def test_no_seam(surface):
    """Steps across the patch's sides are like those inside it."""
    for axis in (0, 1):
        steps = np.abs(surface - np.roll(surface, 1, axis)).swapaxes(0, axis)
        inside = steps[1:].mean(axis=1)
        assert steps[0].mean() < inside.mean() + 4 * inside.std()


def test_cushions_and_furrows(surface):
    """Skin is skewed: wide cushions above the mean plane, narrow furrows below (z points down)."""
    assert (surface < 0).mean() > 0.6 and surface.max() > 2 * -surface.min()


def test_seeds_differ_and_repeat():
    a, b, c = (relief.furrowed(relief.FOREARM, SIZE, SAMPLES, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b) and not np.allclose(a, c)


def test_one_family_has_its_number_of_furrows_depth_and_width():
    family = relief.FurrowFamily(angle_deg=90, spacing_mm=0.5, depth_um=60, width_um=200)
    depth = relief.furrowed([family], (4.0, 4.0), (320, 320), noise_um=0)
    depth -= depth.min()
    furrowed = depth > 0.016  # all but the rounding of the cushions between
    starts = furrowed & ~np.roll(furrowed, 1, axis=0)
    assert 7.2 < starts.sum(axis=0).mean() < 8.8
    assert 0.30 < furrowed.mean() < 0.50
    assert 0.045 < depth[(depth > np.roll(depth, 1, 0)) & (depth > np.roll(depth, -1, 0))].mean() < 0.065


def test_cushions_are_round():
    """Between the V's the surface goes on to rise, by up to a quarter of the depth, and far less steeply."""
    family = relief.FurrowFamily(angle_deg=90, spacing_mm=0.8, depth_um=60, width_um=100)
    depth = relief.furrowed([family], (4.0, 4.0), (640, 640), noise_um=0)
    slope = np.abs(np.diff(depth, axis=0)) / (4.0 / 640)
    cushion = depth[1:] - depth.min() < 0.012
    assert 0 < np.median(slope[cushion]) < 0.1 and 0.5 < cushion.mean() < 0.9 and slope.max() > 0.6


def test_furrows_wander():
    """A furrow leaves its straight line by a good part of the spacing, and its depth comes and goes along it."""
    family = relief.FurrowFamily(angle_deg=0, spacing_mm=1.0, depth_um=60, width_um=100)
    depth = relief.furrowed([family], (4.0, 4.0), (320, 320), noise_um=0)
    line = depth[:, :160].argmax(axis=1) * 4.0 / 320
    along = depth.max(axis=1)
    assert line.std() > 0.05 and 0.1 < along.std() / (along.mean() - depth.min()) < 0.4


def test_age_makes_furrows_fewer_deeper_and_of_one_direction():
    young, old = aging("forearm", 30), aging("forearm", 80)
    assert young == YOUNG and old.depth == pytest.approx(2.2) and old.spacing == 2 and old.anisotropy == 0.6
    assert aging("forearm", 38).depth == 1 and aging("cheek", 80).depth == pytest.approx(1.6)
    assert aging("forearm", 80, anisotropy=0).anisotropy == 0
    first, second, *_ = relief.aged_families(relief.FOREARM, old)
    assert first.depth_um == pytest.approx(99) and second.depth_um == pytest.approx(0.4 * 99)
    assert first.spacing_mm == second.spacing_mm == 0.9


def test_anisotropy_makes_long_cells():
    """Steps along a cell are fewer than across it."""
    long = relief.polygonal(SIZE, SAMPLES, noise_um=0, aging=Aging(1.0, 1.0, 0.6), pore_depth_um=0)
    along, across = (np.abs(np.diff(long, axis=axis)).mean() for axis in (0, 1))
    assert across > 1.5 * along


def test_furrows_wider_apart_than_the_patch():
    with pytest.raises(InputError, match="do not fit"):
        relief.furrowed([relief.FurrowFamily(0, 50, 40, 100)], SIZE, SAMPLES)


def test_height_map_keeps_heights_up_and_mean_zero():
    heights = np.zeros((8, 6))
    heights[2, 3] = 48
    surface = relief.height_map(heights, (8, 6))
    assert np.isclose(surface[2, 3], -0.047) and np.isclose(surface[0, 0], 0.001)


def test_height_map_resampling_keeps_waves():
    x = (np.arange(300) + 0.5) / 300
    coarse = relief.height_map(np.tile(10 * np.sin(2 * np.pi * x)[:, None], (1, 5)), (60, 40))
    assert np.allclose(coarse, -0.01 * np.sin(2 * np.pi * (np.arange(60) + 0.5) / 60)[:, None], atol=1e-5)
    fine = relief.height_map(np.tile(10 * np.sin(2 * np.pi * x[::10])[:, None], (1, 5)), (90, 5))
    assert fine.shape == (90, 5) and np.abs(fine).max() < 0.0101


def test_spline_passes_through_its_samples():
    samples = np.random.default_rng(0).standard_normal((7, 5))
    x, y = (np.arange(7) + 0.5) / 7 * SIZE[0], (np.arange(5) + 0.5) / 5 * SIZE[1]
    control = spline.control_points(samples)
    assert np.allclose(spline.evaluate_grid(control, SIZE, x, y), samples, atol=1e-12)
    assert np.allclose(spline.evaluate_grid(control, SIZE, x + SIZE[0], y - SIZE[1]), samples, atol=1e-10)


def test_spline_is_smooth_and_within_its_control_points():
    control = np.random.default_rng(1).standard_normal((6, 6))
    x = np.linspace(0, 1, 2001)
    z = spline.evaluate_grid(control, (1.0, 1.0), x, np.array([0.3]))[:, 0]
    slope = np.diff(z) / np.diff(x)
    assert np.abs(np.diff(slope)).max() < 0.2 and control.min() <= z.min() and z.max() <= control.max()
