"""Beam radiance estimate, second half: the kernel of equation (3) as a filter on the image of a depth slab.

The paper's biweight 3 / (pi r^2) (1 - (d / r)^2)^2, sampled at the ray lattice and normalized over the rays inside the
patch, so that nothing is lost where the kernel reaches over its side. Variance r^2 / 8 an axis: the bias of a kernel of
radius r is (r^2 / 16) times the Laplacian of the in-scattered light.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel, kernel


def biweight(radius: float) -> np.ndarray:
    """Weights of the biweight of a radius in lattice steps, summing to 1; the single ray for a radius up to 1."""
    reach = max(0, int(np.ceil(radius)) - 1)
    offset = np.arange(-reach, reach + 1)
    square = (offset[:, None] ** 2 + offset[None, :] ** 2) / max(radius, 1e-9) ** 2
    weights = np.clip(1.0 - square, 0.0, None) ** 2
    if reach == 0:
        weights = np.ones((1, 1))
    return (weights / weights.sum()).astype(np.float32)


@block_kernel
def _add_shifted(source, target, row_offset, column_offset, weight, h, w):
    for i in range(h):
        for j in range(w):
            target[i, j] += weight * source[i + row_offset, j + column_offset]


@kernel
def _correlate(padded, weights, h, w):
    """Correlation of a padded image with a square kernel, one shifted sum a weight."""
    out = np.zeros((h, w), np.float32)
    for a in range(weights.shape[0]):
        for b in range(weights.shape[1]):
            if weights[a, b] != 0.0:
                _add_shifted(padded, out, a, b, weights[a, b], h, w)
    return out


def correlate(image: np.ndarray, weights: np.ndarray, wrap: bool) -> np.ndarray:
    """Image (h, w) f4 correlated with odd square weights; beyond its edge lies 0, or the image again."""
    reach = weights.shape[0] // 2
    if reach == 0:
        return image * weights[0, 0]
    padded = np.pad(image, reach, mode="wrap" if wrap else "constant")
    return _correlate(padded, weights, *image.shape)


def filter_slab(image: np.ndarray, level: np.ndarray, radii: np.ndarray, inside: np.ndarray, wrap: bool) -> np.ndarray:
    """A slab image filtered with each ray's own radius.

    Parameters
    ----------
    image : (h, w) f4.
    level : (h, w) int, index of each ray's radius; radii : in lattice steps.
    inside : (h, w) f4, 1 for rays that meet the skin.
    wrap : the lattice repeats with the patch.
    """
    out = np.zeros_like(image)
    for k in np.unique(level):
        weights = biweight(radii[k])
        share = correlate(inside, weights, wrap)
        chosen = level == k
        filtered = correlate(image, weights, wrap)
        out[chosen] = (filtered / np.maximum(share, 1e-6))[chosen]
    return out * inside
