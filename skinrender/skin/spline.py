"""Periodic biquadratic B-spline height fields: smooth (C1) in position and normal.

A field is an array of control points at cell centers ((i + 0.5) Lx/hx, (j + 0.5) Ly/hy). Control points, unlike
samples, bound the surface: it never leaves the range of the nine points around it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def control_points(samples: np.ndarray) -> np.ndarray:
    """Control points (hx, hy) of the periodic spline that passes through the samples at the cell centers.

    At a cell center the spline is the (1, 6, 1)/8 mean of its control points along each axis; this is undone in
    Fourier space, where that mean is at least 1/2.
    """
    spectrum = np.fft.rfft2(samples)
    gain_x = 0.75 + 0.25 * np.cos(2 * np.pi * np.fft.fftfreq(samples.shape[0]))
    gain_y = 0.75 + 0.25 * np.cos(2 * np.pi * np.fft.rfftfreq(samples.shape[1]))
    return np.fft.irfft2(spectrum / (gain_x[:, None] * gain_y), s=samples.shape)


def evaluate_grid(control: np.ndarray, size_mm: tuple[float, float], x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Heights (len(x), len(y)) of the spline at the points of a rectangular grid, mm."""
    along_x = _along_first(np.asarray(control, float), size_mm[0], x_mm)
    return _along_first(along_x.T, size_mm[1], y_mm).T


def _along_first(control: np.ndarray, length_mm: float, at_mm: np.ndarray) -> np.ndarray:
    count = control.shape[0]
    position = np.asarray(at_mm, float) * (count / length_mm) - 0.5
    nearest = np.floor(position + 0.5).astype(int)
    before, own, after = _weights((position - nearest)[:, None])
    return before * control[(nearest - 1) % count] + own * control[nearest % count] + after * control[(nearest + 1) % count]


def _weights(t):
    """Of three neighboring control points, t cells (-0.5 to 0.5) from the middle one."""
    return 0.5 * (0.5 - t) ** 2, 0.75 - t**2, 0.5 * (0.5 + t) ** 2


def center_weights(shift: float) -> tuple[int, tuple[float, float, float]]:
    """First of the three control points that tell the height `shift` cells beside a cell's center, counted from the
    cell's own, and their weights."""
    nearest = int(np.floor(shift + 0.5))
    return nearest - 1, _weights(shift - nearest)


def weighted_sum(parts: Sequence[np.ndarray], weights: Sequence[float], out: np.ndarray, work: np.ndarray) -> np.ndarray:
    """Sum of weighted arrays into `out`; work: of its shape. Makes no array, whose memory would cost more than the sum."""
    np.multiply(parts[0], weights[0], out=out)
    for part, weight in zip(parts[1:], weights[1:]):
        np.add(out, np.multiply(part, weight, out=work), out=out)
    return out
