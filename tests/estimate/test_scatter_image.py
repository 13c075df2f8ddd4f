"""Standard errors from batches of rounds are the true ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from skinrender.estimate.scatter_image import MOST_BATCHES, batch_stderr, batches_of
from skinrender.photonmap.light import light_from_scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from tests.maps import W_PER_MM2, Lit, make_map, see, slab_data, slab_layer
from tests.stats import threshold


@pytest.mark.parametrize("rounds", [1, 2, 7, MOST_BATCHES, 32, 41, 1000])
def test_batches_hold_every_round_once_in_order(rounds):
    batches = batches_of(rounds)
    sizes = [len(batch) for batch in batches]
    assert np.array_equal(np.concatenate(batches), np.arange(rounds))
    assert len(batches) == min(rounds, MOST_BATCHES)
    assert max(sizes) - min(sizes) <= 1


def test_single_batch_says_that_it_does_not_know():
    assert np.all(np.isinf(batch_stderr(np.ones((1, 3)), np.array([5]))))


def test_equal_batches_give_the_textbook_error():
    values = np.random.default_rng(1).normal(size=(20, 4))
    assert batch_stderr(values, np.full(20, 3)) == pytest.approx(values.std(axis=0, ddof=1) / np.sqrt(20))


def test_error_of_unequal_batches_follows_chi_square():
    """Batches of n rounds have the variance sigma^2 / n; 19 degrees of freedom remain of 20."""
    rounds, sigma = np.repeat([2, 3, 7], [8, 8, 4]), 0.3
    noise = np.random.default_rng(2).normal(size=(len(rounds), 5000))
    values = 10.0 + noise * (sigma / np.sqrt(rounds))[:, None]
    true_variance = sigma**2 / rounds.sum()
    chi2 = (len(rounds) - 1) * batch_stderr(values, rounds) ** 2 / true_variance
    assert stats.kstest(chi2, stats.chi2(len(rounds) - 1).cdf).pvalue > threshold()


SEEDS = 60
APART = 8
"""Pixels between those whose noise is compared; kernels do not join them."""


@pytest.fixture(scope="module", params=["beam", "point"])
def pictures(request):
    """Many pictures of one slab from independent seeds, with their summaries."""
    scene = make_scene(slab_data([slab_layer(0.5, 0.5, 10.0, 0.5, 1.4)], {"kind": "collimated"}, size_mm=3.0, pixels=24))
    volume, light = build_volume(scene), light_from_scene(scene)
    maps = (make_map(volume, light, 400, seed=seed) for seed in range(SEEDS))
    return [see(Lit(scene, volume, photons), request.param, gather_count=100) for photons in maps]


def test_pictures_spread_as_the_error_of_their_mean_says(pictures):
    mean = np.array([summary.mean_radiance for _, summary in pictures])
    claimed = np.mean([summary.mean_radiance_stderr**2 for _, summary in pictures])
    ratio = mean.var(ddof=1) / claimed
    spread = stats.f(SEEDS - 1, SEEDS * (MOST_BATCHES - 1))
    assert min(spread.cdf(ratio), spread.sf(ratio)) > 0.5 * threshold()


def test_pictures_spread_as_the_error_of_each_pixel_says(pictures):
    step = slice(APART // 2, None, APART)
    y = np.array([image.y()[step, step].ravel() for image, _ in pictures])
    claimed = np.array([image.stderr_Y[step, step].ravel() for image, _ in pictures], float) ** 2
    degrees = (SEEDS - 1) * y.shape[1]
    spread = stats.chi2(degrees)
    ratio = degrees * y.var(axis=0, ddof=1).mean() / claimed.mean()
    assert min(spread.cdf(ratio), spread.sf(ratio)) > 0.5 * threshold()


def test_noise_of_a_pixel_is_not_that_of_the_mean(pictures):
    image, summary = pictures[0]
    assert image.stderr_Y.mean() * W_PER_MM2 > 2.0 * summary.mean_radiance_stderr
