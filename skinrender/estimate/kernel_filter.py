"""Beam radiance estimate, second half: the kernel of equation (3) as a filter on the image of a depth slab.

The paper's biweight of radius r has the variance r^2 / 8 an axis, and that alone decides the bias, (r^2 / 16) times the
Laplacian of the in-scattered light. The Gaussian of the same variance is taken in its place because it is separable:
2 x 25 weights instead of 450 for a radius of 12 rays. It is normalized over the rays inside the patch, so that nothing
is lost where the kernel reaches over its side.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import allocating_kernel, block_kernel

_REACH = 3.0  # standard deviations; 0.3 % of the weight lies beyond and is given to the rest


def gaussian(radius: float) -> np.ndarray:
    """Weights on one axis of the kernel of a radius in ray spacings; the single ray for a radius up to 1."""
    if radius <= 1.0:
        return np.ones(1, np.float32)
    sigma = radius / math.sqrt(8.0)
    reach = max(1, int(math.ceil(_REACH * sigma)))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)


@block_kernel
def _add_scaled(target, source, weight):
    for j in range(target.size):
        target[j] += weight * source[j]


@allocating_kernel
def _add_correlation(image, weights, chosen, first, last, wrap, out):
    """Adds `chosen` times the image correlated with `weights` on both axes; beyond its edge lies 0, or it again.

    chosen (h, w); in row i it is 0 outside the columns first[i]..last[i]-1, which are left out.
    """
    h, w = image.shape
    reach = weights.size // 2
    row = np.empty(w + 2 * reach, np.float32)
    blurred = np.empty(w, np.float32)
    for i in range(h):
        low, high = first[i], last[i]
        if low >= high:
            continue
        row[:] = 0.0
        for k in range(weights.size):
            source = i + k - reach
            if wrap:
                source %= h
            if 0 <= source < h:
                _add_scaled(row[reach : reach + w], image[source], weights[k])
        if wrap:
            for k in range(reach):
                row[k] = row[reach + (w - reach + k) % w]
                row[reach + w + k] = row[reach + k % w]
        part = blurred[: high - low]
        part[:] = 0.0
        for k in range(weights.size):
            _add_scaled(part, row[low + k : high + k], weights[k])
        for j in range(low, high):
            out[i, j] += chosen[i, j] * part[j - low]


def correlate(image: np.ndarray, weights: np.ndarray, wrap: bool) -> np.ndarray:
    """Image (h, w) f4 correlated with odd weights on both axes."""
    h, w = image.shape
    out = np.zeros_like(image)
    _add_correlation(image, weights, np.ones_like(image), np.zeros(h, np.int64), np.full(h, w), wrap, out)
    return out


class SlabFilter:
    """Filters slab images with each ray's own radius.

    Parameters
    ----------
    level : (h, w) int, index of each ray's radius; radii : in ray spacings.
    inside : (h, w) f4, 1 for rays that meet the skin.
    wrap : the lattice repeats with the patch.

    Attributes
    ----------
    radius : (h, w) of each ray, in ray spacings.
    """

    def __init__(self, level: np.ndarray, radii: np.ndarray, inside: np.ndarray, wrap: bool):
        self.wrap = wrap
        self.radius = radii[level]
        self.parts = []
        for k in np.unique(level):
            weights = gaussian(radii[k])
            share = np.maximum(correlate(inside, weights, wrap), 1e-6)
            chosen = np.where(level == k, inside / share, 0.0).astype(np.float32)
            held = chosen > 0.0
            first = np.where(held.any(axis=1), held.argmax(axis=1), 0)
            last = np.where(held.any(axis=1), level.shape[1] - held[:, ::-1].argmax(axis=1), 0)
            self.parts.append((weights, chosen, first, last))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The image (h, w) f4, filtered; 0 for rays that miss."""
        out = np.zeros_like(image)
        if image.any():
            for weights, chosen, first, last in self.parts:
                _add_correlation(image, weights, chosen, first, last, self.wrap, out)
        return out
