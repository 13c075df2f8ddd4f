"""Noise, bias and their standard errors on synthetic pictures whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skinrender.analysis.error_stats import (
    Uncertain,
    bias_of_mean,
    bias_squared,
    color_noise,
    divisor,
    divisor_side,
    fit_power_law,
    noise_relative,
    noise_squared,
    relative_squared_error,
    squared_error,
    tile_mean,
)

SIDE = 32


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def truth():
    return np.linspace(0.5, 1.5, SIDE * SIDE).reshape(SIDE, SIDE)


def noisy(rng, mean, sigma, count):
    return mean + sigma * rng.normal(size=(count, *mean.shape))


def z_of(values, expected):
    values = np.asarray(values)
    return (values.mean() - expected) / (values.std(ddof=1) / math.sqrt(len(values)))


def test_the_references_variance_is_subtracted_without_bias(rng, truth):
    """A picture of much less noise than the reference: the plain square would be off by 25 times the error itself."""
    sigma, of_half = 0.02, 0.14
    found = [squared_error(noisy(rng, truth, sigma, 1)[0], noisy(rng, truth, of_half, 2)).value for _ in range(200)]
    assert abs(z_of(found, sigma**2)) < 4
    plain = [np.mean((noisy(rng, truth, sigma, 1)[0] - noisy(rng, truth, of_half, 2).mean(axis=0)) ** 2) for _ in range(20)]
    assert np.mean(plain) > 10 * sigma**2


def test_errors_within_noise_may_come_out_negative(rng, truth):
    found = [relative_squared_error(truth, noisy(rng, truth, 0.1, 2)).value for _ in range(100)]
    assert min(found) < 0 < max(found)
    assert abs(z_of(found, 0.0)) < 4


def test_relative_error_is_relative(rng, truth):
    exact = np.stack([truth, truth])
    assert relative_squared_error(1.1 * truth, exact).value == pytest.approx(0.01)
    assert relative_squared_error(1e30 * 1.1 * truth, 1e30 * exact).value == pytest.approx(0.01)
    both = relative_squared_error(np.stack([1.1 * truth, 1.2 * truth]), exact)
    assert both.value == pytest.approx(0.5 * (0.01 + 0.04))


def test_dark_pixels_of_the_reference_are_left_out(truth):
    dark = truth.copy()
    dark[:16] = 0.0
    assert relative_squared_error(dark + 0.1 * truth, np.stack([dark, dark])).value == pytest.approx(0.01)
    nothing = relative_squared_error(truth, np.zeros((2, SIDE, SIDE)))
    assert math.isnan(nothing.value) and math.isnan(nothing.stderr)


def test_noise_common_to_square_and_divisor_does_no_harm(rng, truth):
    """With R itself below the line a bias of 3 % would be seen as 8 %."""
    found = [relative_squared_error(1.03 * truth, noisy(rng, truth, 0.2 * truth, 2)).value for _ in range(200)]
    assert np.mean(found) == pytest.approx(0.03**2, rel=0.3)
    halves = noisy(rng, truth, 0.2 * truth, 2)
    assert divisor_side(halves) == 9
    scale, lit = divisor(halves)
    assert lit.all() and np.std(scale / truth) < 0.03
    assert divisor(np.stack([truth, truth]))[0] == pytest.approx(truth)


def test_noise_and_bias_are_told_apart(rng, truth):
    bias, sigma = 0.05, 0.2
    noise2, bias2 = [], []
    for _ in range(100):
        pictures = noisy(rng, (1.0 + bias) * truth, sigma * truth, 3)
        halves = noisy(rng, truth, 0.05 * truth, 2)
        noise2.append(noise_squared(pictures, np.stack([truth, truth])).value)
        bias2.append(bias_squared(pictures, halves))
    assert abs(z_of(noise2, sigma**2)) < 4
    values = np.array([part.value for part in bias2])
    assert values.mean() == pytest.approx(bias**2, rel=0.06)
    assert np.mean([part.stderr for part in bias2]) == pytest.approx(values.std(ddof=1), rel=0.25)


def test_the_spread_of_tiles_gives_the_standard_error(rng):
    lit = np.ones((SIDE, SIDE), bool)
    means = [tile_mean(rng.normal(size=(SIDE, SIDE)), lit) for _ in range(400)]
    spread = np.std([mean.value for mean in means], ddof=1)
    assert np.sqrt(np.mean([mean.stderr**2 for mean in means])) == pytest.approx(spread, rel=0.15)
    outside = [not mean.interval[0] <= 0 <= mean.interval[1] for mean in means]
    assert 0.02 < np.mean(outside) < 0.09


def test_tiles_of_tiny_pictures():
    one = tile_mean(np.ones((1, 1)), np.ones((1, 1), bool))
    assert one.value == 1 and math.isnan(one.stderr)
    assert tile_mean(np.arange(6.0).reshape(2, 3), np.ones((2, 3), bool)).value == pytest.approx(2.5)


def test_bias_of_the_mean_has_the_noise_of_both():
    found = bias_of_mean([Uncertain(1.1, 0.02), Uncertain(1.1, 0.02)], Uncertain(1.0, 0.01))
    assert found.value == pytest.approx(0.1)
    assert found.stderr == pytest.approx(1.1 * math.hypot(math.sqrt(2) * 0.02 / 2.2, 0.01))


def test_noise_from_pairs(rng, truth):
    assert noise_relative(noisy(rng, truth, 0.1 * truth, 4)) == pytest.approx(0.1, rel=0.03)


def test_color_noise_of_lightness(rng):
    """Around L* = 50 and without color, CIEDE2000 is the difference of lightness."""
    labs = np.zeros((3, 64, 64, 3))
    labs[..., 0] = 50 + 0.3 * rng.normal(size=(3, 64, 64))
    expected = 0.3 * math.sqrt(2 / math.pi)
    assert color_noise(labs) == pytest.approx(expected, rel=0.03)


def test_a_power_law_is_found_with_its_interval(rng):
    seconds = np.repeat([1.0, 10.0, 100.0, 1000.0], 3)
    inside = 0
    for _ in range(200):
        law = fit_power_law(seconds, 3.0 / seconds * np.exp(0.2 * rng.normal(size=seconds.size)))
        inside += abs(law.slope + 1.0) <= law.half_width
    assert 180 <= inside <= 199
    exact = fit_power_law(seconds, 3.0 / seconds**0.5)
    assert exact.slope == pytest.approx(-0.5)
    assert exact.scale == pytest.approx(3.0)


def test_no_law_where_there_is_nothing_to_fit():
    assert fit_power_law(np.array([1.0, 2.0]), np.array([-1.0, 1.0])) is None
    assert fit_power_law(np.array([2.0, 2.0, 2.0]), np.ones(3)) is None
    assert fit_power_law(np.array([]), np.array([])) is None
    assert math.isnan(fit_power_law(np.array([1.0, 2.0]), np.array([2.0, 1.0])).half_width)
