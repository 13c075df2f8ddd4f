"""Henyey-Greenstein: normalized, mean cosine g, sampled as evaluated, quiet at the limits."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from skinrender.transport.phase import phase_hg, sample_hg

G = [-0.999, -0.5, -1e-9, 0.0, 1e-9, 0.8, 0.95, 0.999]


def cumulative(cos_theta, g):
    """Closed-form probability of a cosine below cos_theta (g not 0)."""
    root = math.sqrt(1.0 + g * g - 2.0 * g * cos_theta)
    return (1.0 - g * g) / (2.0 * g) * (1.0 / root - 1.0 / (1.0 + g))


@pytest.mark.parametrize("g", [-0.9, -0.3, 0.0, 0.5, 0.9])
def test_normalized_with_mean_cosine_g(g):
    x, w = np.polynomial.legendre.leggauss(400)
    p = np.array([phase_hg(c, g) for c in x]) * 2.0 * math.pi
    assert (w @ p, w @ (p * x)) == pytest.approx((1.0, g), abs=1e-10)


def test_forward_is_plus_one():
    assert phase_hg(1.0, 0.9) == pytest.approx(1.9 / (4.0 * math.pi * 0.01))
    assert phase_hg(-1.0, -0.9) == pytest.approx(1.9 / (4.0 * math.pi * 0.01))


@pytest.mark.parametrize("g", [-0.999, -0.5, 0.3, 0.8, 0.999])
def test_sampler_inverts_the_distribution(g):
    for u in [1e-6, 0.1, 0.5, 0.9]:
        assert cumulative(1.0 - sample_hg(g, u), g) == pytest.approx(u, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("g", G)
def test_samples_stay_in_range_and_reach_both_poles(g):
    samples = [sample_hg(g, u) for u in (0.0, 2.0**-33, 0.3, 1.0 - 2.0**-33, 1.0)]
    assert all(0.0 <= s <= 2.0 + 1e-12 for s in samples)
    assert samples[0] == pytest.approx(2.0)
    assert samples[-1] == 0.0


def test_isotropic_limit_is_continuous():
    assert sample_hg(1e-9, 0.3) == pytest.approx(sample_hg(0.0, 0.3), abs=1e-8)
    assert sample_hg(0.0, 0.3) == pytest.approx(2.0 * (1.0 - 0.3))
    assert phase_hg(0.3, 0.0) == pytest.approx(0.25 / math.pi)


def test_chi_square_of_samples_against_the_value():
    g, n = 0.7, 20_000
    cosines = 1.0 - np.array([sample_hg(g, u) for u in np.random.default_rng(11).random(n)])
    edges = np.linspace(-1.0, 1.0, 22)
    x, w = np.polynomial.legendre.leggauss(12)
    expected = []
    for a, b in itertools.pairwise(edges):
        nodes = 0.5 * (b - a) * x + 0.5 * (a + b)
        expected.append(n * math.pi * (b - a) * (w @ [phase_hg(c, g) for c in nodes]))
    assert sum(expected) == pytest.approx(n, rel=1e-9)
    counts = np.histogram(cosines, edges)[0]
    assert stats.chisquare(counts, np.array(expected) * n / sum(expected)).pvalue > 1e-3


@pytest.mark.parametrize("g", [1.0 - 1e-12, -1.0 + 1e-12])
def test_a_cosine_rounded_beyond_1_is_the_peak(g):
    cosine = math.copysign(1.0, g)
    assert phase_hg(cosine * (1.0 + 4e-16), g) == phase_hg(cosine, g) > 0.0
