"""Errors of pictures against a reference that is noisy itself: noise and bias apart, each with its standard error.

The reference comes in two independent halves R1, R2. With A a picture, E[(A - R1)(A - R2)] = (mean A - truth)^2 + var A:
the reference's variance drops out, whatever its size; so what is small may come out negative by chance. For two pictures of
other photons, E[(A - R1)(A' - R2)] is the bias squared alone. What these are divided by is smoothed as far as the reference
is noisy: noise common to both would not drop out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.film.color import delta_e

TILES = 4
"""Parts along each side of the picture whose spread gives standard errors: noise is alike within a kernel's width."""
CONFIDENCE, CERTAINTY = 0.95, 0.999
"""Of the intervals that are told; of what is claimed to be above 0, as many are looked at in a report."""
QUIET = 0.02
"""Relative noise of a divisor that does no harm."""
WIDEST = 9
"""Pixels."""


@dataclass(frozen=True)
class Uncertain:
    """A value and its standard error; nan where unknown."""

    value: float
    stderr: float

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of 95 %, by Student's t over the tiles."""
        half = student(TILES * TILES - 1) * self.stderr
        return self.value - half, self.value + half

    @property
    def is_surely_positive(self) -> bool:
        """Whether 0 is ruled out at 99.9 %."""
        return self.value > student(TILES * TILES - 1, CERTAINTY) * self.stderr


@dataclass(frozen=True)
class PowerLaw:
    """y = scale x^slope, fitted to logarithms.

    Parameters
    ----------
    slope, half_width : with the half width of its 95 % confidence interval (nan with two points).
    scale : y at x = 1.
    points : pairs that it was fitted to.
    """

    slope: float
    half_width: float
    scale: float
    points: int

    def at(self, x: float) -> float:
        """y at x."""
        return self.scale * x**self.slope


def student(freedom: int, confidence: float = CONFIDENCE) -> float:
    """Half width of a confidence interval in standard errors."""
    from scipy.stats import t

    return float(t.ppf(0.5 + 0.5 * confidence, freedom))


def squared_error(y: np.ndarray, halves: np.ndarray) -> Uncertain:
    """Mean of (A - truth)^2 over all pixels, the reference's variance subtracted.

    Parameters
    ----------
    y : (h, w) luminance.
    halves : (2, h, w) luminance of the reference's halves.
    """
    product = (y - halves[0]) * (y - halves[1])
    return tile_mean(product, np.ones(y.shape, bool))


def relative_squared_error(y: np.ndarray, halves: np.ndarray) -> Uncertain:
    """relMSE: mean of (A - truth)^2 / R^2 over the lit pixels, the reference's variance subtracted; R: see `divisor`.

    Parameters
    ----------
    y : (h, w), or (n, h, w) for the mean over n pictures.
    halves : (2, h, w).
    """
    product = np.mean(np.reshape((y - halves[0]) * (y - halves[1]), (-1, *halves[0].shape)), axis=0)
    return _relative_mean(product, halves)


def noise_squared(pictures: np.ndarray, halves: np.ndarray) -> Uncertain:
    """Mean over the lit pixels of the variance of a picture, relative to R^2.

    Parameters
    ----------
    pictures : (n, h, w), n >= 2, of independent photons.
    """
    return _relative_mean(np.var(pictures, axis=0, ddof=1), halves)


def bias_squared(pictures: np.ndarray, halves: np.ndarray) -> Uncertain:
    """Mean over the lit pixels of (mean A - truth)^2 / R^2, free of the noise of pictures and reference.

    Parameters
    ----------
    pictures : (n, h, w), n >= 2, of independent photons.
    """
    first, second = pictures - halves[0], pictures - halves[1]
    pairs = len(pictures) * (len(pictures) - 1)
    product = (first.sum(axis=0) * second.sum(axis=0) - (first * second).sum(axis=0)) / pairs
    return _relative_mean(product, halves)


def divisor(halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminance that errors are relative to, and which pixels are lit.

    The mean of the halves, where it is noisy by more than `QUIET` averaged over n x n lit pixels, n = noise / `QUIET`.
    """
    reference = np.mean(halves, axis=0, dtype=float)
    lit = reference > 0
    side = divisor_side(halves)
    if side == 1:
        return reference, lit
    from scipy.ndimage import uniform_filter

    scale = float(reference.max())
    around = uniform_filter(np.where(lit, reference / scale, 0.0), side, mode="nearest")
    share = uniform_filter(lit.astype(float), side, mode="nearest")
    return np.where(lit, scale * np.divide(around, share, out=np.zeros_like(share), where=lit), reference), lit


def divisor_side(halves: np.ndarray) -> int:
    """Pixels along the side that `divisor` averages over, odd."""
    half = math.ceil(0.5 * (reference_noise(halves) / QUIET - 1.0) - 1e-9)
    return 2 * min(max(0, half), WIDEST // 2) + 1


def tile_mean(values: np.ndarray, lit: np.ndarray) -> Uncertain:
    """Mean over the lit pixels, with the standard error that the spread of 4 x 4 parts of the picture tells."""
    parts = _tiles(values.shape)
    counts = np.array([lit[part].sum() for part in parts], dtype=float)
    sums = np.array([values[part][lit[part]].sum(dtype=float) for part in parts])
    parts_lit = int((counts > 0).sum())
    if not parts_lit:
        return Uncertain(math.nan, math.nan)
    mean = sums.sum() / counts.sum()
    if parts_lit < 2:
        return Uncertain(float(mean), math.nan)
    spread = np.sum((sums - mean * counts) ** 2) * parts_lit / (parts_lit - 1)
    return Uncertain(float(mean), float(np.sqrt(spread) / counts.sum()))


def bias_of_mean(means: Sequence[Uncertain], reference: Uncertain) -> Uncertain:
    """Mean A / mean R - 1, from the mean luminances of pictures of independent photons."""
    mean = sum(m.value for m in means) / len(means)
    relative = math.sqrt(sum(m.stderr**2 for m in means)) / (len(means) * mean)
    ratio = mean / reference.value
    return Uncertain(ratio - 1.0, ratio * math.hypot(relative, reference.stderr / reference.value))


def noise_relative(pictures: np.ndarray) -> float:
    """Standard error of a pixel over its luminance, mean over the lit pixels, from pairs of pictures (n, h, w).

    Of normal noise: E|A - A'| = 2 sigma / sqrt(pi). Comparable with what a picture claims, ``stderr_relative_mean``.
    """
    mean = pictures.mean(axis=0)
    lit = mean > 0
    apart = np.mean([np.abs(a - b)[lit] for a, b in _pairs(pictures)], axis=0)
    return float(np.mean(0.5 * math.sqrt(math.pi) * apart / mean[lit])) if lit.any() else math.nan


def color_noise(labs: np.ndarray) -> float:
    """Mean CIEDE2000 between pictures (n, h, w, 3) of independent photons, over sqrt 2: the noise of one."""
    return float(np.mean([delta_e(a, b).mean() for a, b in _pairs(labs)]) / math.sqrt(2.0))


def fit_power_law(x: np.ndarray, y: np.ndarray) -> PowerLaw | None:
    """Least squares on logarithms of positive pairs; None where fewer than two values of x have one."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    fit = (x > 0) & (y > 0)
    log_x, log_y = np.log(x[fit]), np.log(y[fit])
    if log_x.size < 2 or np.ptp(log_x) < 1e-9:
        return None
    apart = log_x - log_x.mean()
    slope = float(apart @ log_y / (apart @ apart))
    start = float(log_y.mean() - slope * log_x.mean())
    freedom = log_x.size - 2
    half = math.nan
    if freedom:
        left = log_y - start - slope * log_x
        half = student(freedom) * math.sqrt(left @ left / freedom / (apart @ apart))
    return PowerLaw(slope, float(half), math.exp(start), int(log_x.size))


def noise_map(halves: np.ndarray) -> np.ndarray:
    """(h, w) half the difference of the halves over their mean: as large as its noise; nan where that is not above 0."""
    mean = np.mean(halves, axis=0, dtype=float)
    return np.divide(0.5 * (halves[0] - halves[1]), mean, out=np.full(mean.shape, np.nan), where=mean > 0)


def reference_noise(halves: np.ndarray) -> float:
    """Root mean square over the lit pixels of the reference's standard error over its luminance; 0 without any."""
    relative = noise_map(halves)
    known = relative[np.isfinite(relative)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _relative_mean(square: np.ndarray, halves: np.ndarray) -> Uncertain:
    scale, lit = divisor(halves)
    return tile_mean(np.divide(square, scale**2, out=np.zeros_like(square), where=lit), lit)


def _pairs(pictures: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(pictures[i], pictures[j]) for i in range(len(pictures)) for j in range(i)]


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    rows, columns = (np.linspace(0, side, min(TILES, side) + 1).astype(int) for side in shape)
    return [
        (slice(top, bottom), slice(left, right))
        for top, bottom in zip(rows, rows[1:])
        for left, right in zip(columns, columns[1:])
    ]
