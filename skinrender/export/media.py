"""A few kinds of voxel that stand for many: the media table of programs that know labels only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_LABELS = 1000
"""Media that MCX's constant memory holds with room for sources and detectors."""
_FINEST = 1e-6
_SMALLEST_PER_MM = 1e-9
_MIXING = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93], np.uint64)
"""Odd factors without pattern, by which four numbers make one."""


@dataclass(frozen=True, eq=False)
class Media:
    """Labels and what they stand for.

    Attributes
    ----------
    label : u1 or u2, one a voxel; 0 = outside the tissue.
    mu_a, mu_s, g, n : (M,) of label 1..M; coefficients in 1/mm.
    error : largest relative error of mu_a or mu_s of a voxel that sharing labels makes.
    """

    label: np.ndarray
    mu_a: np.ndarray
    mu_s: np.ndarray
    g: np.ndarray
    n: np.ndarray
    error: float


def make_media(
    mu_a: np.ndarray,
    mu_s: np.ndarray,
    scatter_g: np.ndarray,
    n: np.ndarray,
    inside: np.ndarray,
    most: int = MOST_LABELS,
) -> Media:
    """At most `most` media for these voxels: coefficients in equal steps of their logarithm, as fine as that allows.

    Parameters
    ----------
    mu_a, mu_s, scatter_g : coefficients, and mu_s g, of the voxels, 1/mm.
    n : refractive index, broadcast to the voxels; never shared by voxels whose index differs.
    inside : bool, voxels of tissue.

    Each medium is the mean of its voxels, so absorption and scattering summed over the volume stay as they are.
    """
    rows = np.stack([values[inside] for values in (mu_a, mu_s, scatter_g, np.broadcast_to(n, inside.shape))])
    member, weight, fine = _merged(_numbers(rows, _FINEST), rows, np.ones(rows.shape[1]))
    number, kinds, step = np.arange(weight.size), fine, _FINEST
    while kinds.shape[1] > most:
        step *= 2.0
        number, _, kinds = _merged(_numbers(fine, step), fine, weight)
    label = np.zeros(inside.shape, np.uint8 if kinds.shape[1] <= 255 else np.uint16)
    label[inside] = number[member] + 1
    error = np.abs(kinds[:2, number] - fine[:2]) / np.maximum(fine[:2], _SMALLEST_PER_MM)
    return Media(label, kinds[0], kinds[1], _g(kinds), kinds[3], float(error.max(initial=0.0)))


def _merged(number: np.ndarray, rows: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group of each column of rows (4, V) by equal `number`, and the groups' weight (K,) and weighted mean (4, K)."""
    _, group = np.unique(number, return_inverse=True)
    total = np.bincount(group, weight)
    return group, total, np.stack([np.bincount(group, row * weight) for row in rows]) / total


def _numbers(rows: np.ndarray, step: float) -> np.ndarray:
    """A number for each column of rows (4, V): equal where all four round to the same step (but for a chance of 2^-64)."""
    rounded = [np.log(np.maximum(row, _SMALLEST_PER_MM)) / step for row in rows[:2]] + [
        _g(rows) / step,
        rows[3] / _FINEST,
    ]
    number = np.zeros(rows.shape[1], np.uint64)
    for values, factor in zip(rounded, _MIXING):
        number ^= np.round(values).astype(np.int64).view(np.uint64) * factor
        number *= factor
        number ^= number >> np.uint64(29)
    return number


def _g(rows: np.ndarray) -> np.ndarray:
    return np.divide(rows[2], rows[1], out=np.zeros_like(rows[1]), where=rows[1] > 0.0)
