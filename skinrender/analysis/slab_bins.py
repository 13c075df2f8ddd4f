"""Bins about the depths and cosines at which truth gives fields: narrow enough for a mean to stand for the value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.analysis.slab_truth import Stack

FREE_PATHS = 0.05
COSINES = 0.02
"""Widest half widths of the bins about a depth (in mean free paths) and about a cosine."""
BIAS = 1e-3
"""Allowed relative difference between the mean over a bin and the value in its middle."""


@dataclass(frozen=True)
class Bin:
    """An interval of a coordinate."""

    low: float
    high: float

    @property
    def width(self) -> float:
        return self.high - self.low


def depth_bins(stack: Stack, z_mm: Sequence[float], layer: Sequence[int], fluence: np.ndarray) -> list[Bin]:
    """A thin bin about each depth (ascending), apart from the others and from the layers' borders."""
    bins = []
    for i, depth in enumerate(z_mm):
        same = [k for k in range(len(z_mm)) if layer[k] == layer[i]]
        half = half_width(np.array([z_mm[k] for k in same]), fluence[same], same.index(i))
        others = [*stack.depth_mm, *(other for other in z_mm if other != depth)]
        half = min(half, 0.45 * min(abs(depth - other) for other in others))
        mu_t = stack.layers[layer[i]].mu_t
        half = min(half, FREE_PATHS / mu_t) if mu_t > 0.0 else half
        bins.append(Bin(depth - half, depth + half))
    return bins


def cosine_bin(mu: np.ndarray, values: np.ndarray, k: int) -> Bin | None:
    """A bin about mu[k] over which the values hardly bend; at 1 one-sided; None where no neighbors tell."""
    if len(mu) < 3:
        return None
    if mu[k] == 1.0:
        slope = abs(values[k] - values[k - 1]) / (mu[k] - mu[k - 1])
        return Bin(1.0 - (min(COSINES, 2.0 * BIAS * values[k] / slope) if slope > 0.0 else COSINES), 1.0)
    half = min(COSINES, half_width(mu, values, k), 0.5 * mu[k], 1.0 - mu[k])
    return Bin(mu[k] - half, mu[k] + half)


def half_width(x: np.ndarray, values: np.ndarray, k: int) -> float:
    """Half width of a bin about x[k] whose mean differs from values[k] by `BIAS`, by the bend about its neighbors."""
    bend = 0.0
    for first in range(max(0, k - 2), min(k, len(x) - 3) + 1):
        a, b, c = x[first : first + 3]
        fa, fb, fc = values[first : first + 3]
        bend = max(bend, abs(2.0 * ((fc - fb) / (c - b) - (fb - fa) / (b - a)) / (c - a)))
    return math.sqrt(6.0 * BIAS * abs(values[k]) / bend) if bend > 0.0 else math.inf


def critical_cosines(stack: Stack, layer: int) -> list[float]:
    """Cosines in a layer at which total reflection at any border begins."""
    n = stack.layers[layer].n
    others = {stack.n_above, stack.n_below, *(other.n for other in stack.layers)}
    return [math.sqrt(1.0 - (other / n) ** 2) for other in others if other < n]


def unscattered_return(stack: Stack) -> float:
    """About the part of the light that inner borders and the bottom send back before it ever scattered."""
    depth, returned = 0.0, 0.0
    lower_index = [*(layer.n for layer in stack.layers[1:]), stack.n_below]
    for layer, lower in zip(stack.layers, lower_index):
        depth += layer.mu_t * layer.thickness_mm
        # diffuse light is oblique, yet never by more than the critical angle: some times the reflectance at normal
        returned += math.exp(-depth) * min(1.0, 4.0 * ((layer.n - lower) / (layer.n + lower)) ** 2)
    return returned


def vertical_cosine(direction: np.ndarray) -> np.ndarray:
    """Cosines with the downward normal of octahedral codes (n, 2), middle of the cell; see `turn.pack_direction`."""
    p = np.abs((direction.astype(np.float64) + (0.5 - 32768.0)) / 32767.0)
    z = 1.0 - p[:, 0] - p[:, 1]
    x = np.where(z < 0.0, 1.0 - p[:, 1], p[:, 0])
    y = np.where(z < 0.0, 1.0 - p[:, 0], p[:, 1])
    return z / np.sqrt(x * x + y * y + z * z)
