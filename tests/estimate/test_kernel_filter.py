"""The beam's kernel as a filter: what it keeps, its edges, and its width."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from skinrender.estimate.kernel_filter import SlabFilter, correlate, gaussian

SHAPE = (21, 34)
FULL = np.ones(SHAPE, np.float32)
RADII = np.array([1.0, 2.5, 6.0])


def picture(seed: int = 1, shape=SHAPE) -> np.ndarray:
    return np.random.default_rng(seed).gamma(0.3, size=shape).astype(np.float32)


def one_radius(radius: float, inside=FULL, wrap: bool = False) -> SlabFilter:
    return SlabFilter(np.zeros(inside.shape, int), np.array([radius]), inside, wrap)


@pytest.mark.parametrize("radius, close", [(1.5, 0.1), (3.0, 0.04), (8.0, 0.04), (30.0, 0.04)])
def test_gaussian_has_unit_sum_and_the_variance_of_the_biweight(radius, close):
    """The biweight 3/(pi r^2) (1 - (d/r)^2)^2 has variance r^2 / 8 on each axis; what lies beyond 3 sigma is cut off."""
    weights = gaussian(radius).astype(float)
    offset = np.arange(weights.size) - weights.size // 2
    assert weights.sum() == pytest.approx(1.0, rel=1e-6)
    assert np.array_equal(weights, weights[::-1])
    assert weights @ offset**2 == pytest.approx(radius**2 / 8.0, rel=close)


@pytest.mark.parametrize("radius", [0.0, 0.5, 1.0])
def test_no_kernel_is_narrower_than_a_ray(radius):
    assert np.array_equal(gaussian(radius), [1.0])
    image = picture()
    assert np.allclose(one_radius(radius)(image), image, rtol=1e-6)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("radius", [2.0, 7.0, 40.0])
def test_correlation_is_scipys(radius, wrap):
    """Also where the kernel is wider than the picture."""
    image, weights = picture(), gaussian(radius)
    mode = "wrap" if wrap else "constant"
    expected = ndimage.correlate1d(image.astype(float), weights, axis=0, mode=mode)
    expected = ndimage.correlate1d(expected, weights, axis=1, mode=mode)
    assert correlate(image, weights, wrap) == pytest.approx(expected, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("radius", RADII)
def test_a_level_picture_stays_level_to_its_edges(radius, wrap):
    assert one_radius(radius, wrap=wrap)(3.0 * FULL) == pytest.approx(3.0 * FULL, rel=1e-5)


@pytest.mark.parametrize("radius", RADII)
def test_wrapped_filter_keeps_the_mean(radius):
    image = picture()
    assert one_radius(radius, wrap=True)(image).mean(dtype=float) == pytest.approx(image.mean(dtype=float), rel=1e-5)


def test_filter_keeps_the_expected_mean_of_even_light():
    """Normalizing at the edges gives border photons other weights; on average over photons that evens out."""
    images = [picture(seed) for seed in range(400)]
    ratio = np.array([one_radius(6.0)(image).mean(dtype=float) / np.mean(images) for image in images])
    assert abs(ratio.mean() - 1.0) < 4.0 * ratio.std() / np.sqrt(len(ratio))
    assert ratio.std() / np.sqrt(len(ratio)) < 0.01


def test_wrapped_filter_knows_no_edge():
    image = picture()
    rolled = one_radius(6.0, wrap=True)(np.roll(image, (5, -9), (0, 1)))
    assert rolled == pytest.approx(np.roll(one_radius(6.0, wrap=True)(image), (5, -9), (0, 1)), rel=1e-4, abs=1e-6)


def test_rays_that_miss_give_nothing_and_get_nothing():
    inside = np.zeros(SHAPE, np.float32)
    inside[4:15, 6:30] = 1.0
    out = one_radius(6.0, inside)(2.0 * inside)
    assert out[inside > 0] == pytest.approx(2.0, rel=1e-5)
    assert not out[inside == 0].any()


def test_each_ray_has_its_own_radius():
    level = np.random.default_rng(2).integers(0, len(RADII), SHAPE)
    image = picture()
    out = SlabFilter(level, RADII, FULL, wrap=False)(image)
    for k, radius in enumerate(RADII):
        assert out[level == k] == pytest.approx(one_radius(radius)(image)[level == k], rel=1e-5, abs=1e-7)


def test_dark_stays_dark_and_light_positive():
    mixed = SlabFilter(np.indices(SHAPE).sum(axis=0) % 3, RADII, FULL, wrap=False)
    assert not mixed(np.zeros(SHAPE, np.float32)).any()
    assert mixed(picture()).min() >= 0.0


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_any_power_of_the_light(scale):
    image = picture()
    scaled = one_radius(6.0)(image * np.float32(scale))
    assert np.isfinite(scaled).all()
    assert scaled / scale == pytest.approx(one_radius(6.0)(image), rel=1e-4, abs=1e-6)
