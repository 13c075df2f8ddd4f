"""Beam radiance estimate, second half: the kernel of equation (3) as a filter on the image of a depth slab.

The paper's biweight of radius r has the variance r^2 / 8 an axis, and that alone decides the bias, (r^2 / 16) times the
Laplacian of the in-scattered light. The Gaussian of the same variance is taken in its place because it is separable:
2 x 25 weights instead of 450 for a radius of 12 rays. It is normalized over the rays inside the patch, so that nothing
is lost where the kernel reaches over its side.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import block_kernel, kernel

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


@kernel
def _correlate(padded, weights, h, w):
    """Separable correlation of an image padded by the kernel's reach: rows first, then along each row."""
    reach = weights.size // 2
    out = np.zeros((h, w), np.float32)
    row = np.empty(w + 2 * reach, np.float32)
    for i in range(h):
        row[:] = 0.0
        for k in range(weights.size):
            _add_scaled(row, padded[i + k], weights[k])
        for k in range(weights.size):
            _add_scaled(out[i], row[k : k + w], weights[k])
    return out


def correlate(image: np.ndarray, weights: np.ndarray, wrap: bool) -> np.ndarray:
    """Image (h, w) f4 correlated with odd weights on both axes; beyond its edge lies 0, or the image again."""
    reach = weights.size // 2
    if reach == 0:
        return image
    padded = np.pad(image, reach, mode="wrap" if wrap else "constant")
    return _correlate(padded, weights, *image.shape)


class SlabFilter:
    """Filters slab images with each ray's own radius.

    Parameters
    ----------
    level : (h, w) int, index of each ray's radius; radii : in ray spacings.
    inside : (h, w) f4, 1 for rays that meet the skin.
    wrap : the lattice repeats with the patch.
    """

    def __init__(self, level: np.ndarray, radii: np.ndarray, inside: np.ndarray, wrap: bool):
        self.inside, self.wrap = inside, wrap
        self.parts = []
        for k in np.unique(level):
            weights = gaussian(radii[k])
            share = np.maximum(correlate(inside, weights, wrap), 1e-6)
            self.parts.append((weights, np.where(level == k, inside / share, 0.0).astype(np.float32)))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The image (h, w) f4, filtered; 0 for rays that miss."""
        if not image.any():
            return image
        return sum(correlate(image, weights, self.wrap) * chosen for weights, chosen in self.parts)
