"""Statistical checks with fixed seeds: a family of comparisons fails by chance once in a thousand times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

SIGNIFICANCE = 1e-3
LEAST_EXPECTED = 5.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def threshold(comparisons: int = 1) -> float:
    """Least p-value that each of so many independent comparisons must reach (Sidak)."""
    return -np.expm1(np.log1p(-SIGNIFICANCE) / comparisons)


def bin_probabilities(density: Callable[[np.ndarray], np.ndarray], edges: np.ndarray) -> np.ndarray:
    """Integral of a density over each bin, by Gauss-Legendre quadrature."""
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    return half * (density(middle[:, None] + half[:, None] * _NODES) @ _WEIGHTS)


def pooled(observed: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts with neighboring bins merged until each expects at least `LEAST_EXPECTED`."""
    group = np.zeros(expected.size, int)
    number, sum_ = 0, 0.0
    for k, value in enumerate(expected.ravel()):
        if sum_ >= LEAST_EXPECTED:
            number, sum_ = number + 1, 0.0
        group[k] = number
        sum_ += value
    if sum_ < LEAST_EXPECTED and number > 0:
        group[group == number] = number - 1
    return np.bincount(group, observed.ravel()), np.bincount(group, expected.ravel())


def assert_fits(counts: np.ndarray, probabilities: np.ndarray, comparisons: int = 1) -> None:
    """Chi-square of counts against the probabilities of their bins, which sum to 1."""
    counts, probabilities = np.asarray(counts), np.asarray(probabilities)
    assert abs(probabilities.sum() - 1.0) < 1e-6
    observed, expected = pooled(counts, probabilities * (counts.sum() / probabilities.sum()))
    assert observed.size > 2
    p = stats.chisquare(observed, expected).pvalue
    assert p > threshold(comparisons), f"chi-square p = {p:.2e} with {observed.size} bins"


def assert_mean(samples: np.ndarray, expected: float, comparisons: int = 1) -> None:
    """z-test of independent samples (n,) against the value that they should have in the mean."""
    error = samples.std(ddof=1) / np.sqrt(samples.size)
    z = (samples.mean() - expected) / error
    p = 2.0 * stats.norm.sf(abs(z))
    assert p > threshold(comparisons), f"mean {samples.mean():.6g} +- {error:.2g}, expected {expected:.6g}, z = {z:.2f}"


def assert_same_means(a: np.ndarray, b: np.ndarray) -> None:
    """Welch's test of two sets of independent batches (n, columns); a column without spread must be equal."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    varies = (np.ptp(a, axis=0) > 0) | (np.ptp(b, axis=0) > 0)
    assert varies.any() and np.array_equal(a[0, ~varies], b[0, ~varies])
    p = np.ones(a.shape[1])
    p[varies] = stats.ttest_ind(a[:, varies], b[:, varies], equal_var=False).pvalue
    k = int(p.argmin())
    assert p[k] > threshold(int(varies.sum())), f"column {k}: {a.mean(0)[k]} and {b.mean(0)[k]}, p = {p[k]:.2e}"


def assert_share(hits: int, trials: int, probability: float, comparisons: int = 1) -> None:
    """Exact binomial test of a share."""
    p = stats.binomtest(int(hits), int(trials), probability).pvalue
    assert p > threshold(comparisons), f"{hits} of {trials}, expected {trials * probability:.1f}, p = {p:.2e}"
