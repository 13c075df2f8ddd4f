"""The polynomials against float64 over all arguments that they can be given."""

from __future__ import annotations

import numpy as np

from skinrender.transport import kernel
from skinrender.transport.blockmath import cos_sin, cos_sin_turn, log_unit


@kernel
def logs(u, out):
    for i in range(u.size):
        out[i] = log_unit(u[i])


@kernel
def circle(turn, out):
    for i in range(turn.size):
        out[0, i], out[1, i] = cos_sin_turn(turn[i])


def log_of(u):
    out = np.empty(u.size, np.float32)
    logs(u, out)
    return out.astype(np.float64)


def relative_error(u):
    exact = np.log(u.astype(np.float64))
    return np.abs(log_of(u) - exact) / np.abs(exact)


def test_log_of_every_float_from_a_quarter_to_one():
    bits = np.arange(np.float32(0.25).view(np.int32), np.float32(1.0).view(np.int32), 3, dtype=np.int32)
    assert relative_error(bits.view(np.float32)).max() < 2.5e-7


def test_log_down_to_the_smallest_uniform_variate():
    mantissa = np.linspace(1.0, 2.0, 4001, endpoint=False, dtype=np.float32)
    for exponent in range(-32, 0):
        assert relative_error(mantissa * np.float32(2.0**exponent)).max() < 2.5e-7


def test_log_of_one_is_exactly_zero():
    assert log_of(np.ones(1, np.float32))[0] == 0.0
    below = np.nextafter(np.float32(1.0), np.float32(0.0)) * np.ones(1, np.float32)
    assert abs(log_of(below)[0] / np.log(float(below[0])) - 1.0) < 1e-6


def test_cos_and_sin_of_every_turn():
    turn = np.linspace(-0.5, 0.5, 1_000_001).astype(np.float32)
    out = np.empty((2, turn.size), np.float32)
    circle(turn, out)
    angle = 2.0 * np.pi * turn.astype(np.float64)
    assert np.abs(out[0] - np.cos(angle)).max() < 4e-7
    assert np.abs(out[1] - np.sin(angle)).max() < 4e-7
    assert np.abs((out.astype(np.float64) ** 2).sum(axis=0) - 1.0).max() < 7e-7


@kernel
def wide_circle(angle, out):
    for i in range(angle.size):
        out[0, i], out[1, i] = cos_sin(angle[i])


def test_cos_and_sin_in_double_over_some_turns():
    angle = np.linspace(-15.0, 15.0, 1_000_001)
    out = np.empty((2, angle.size))
    wide_circle(angle, out)
    assert np.abs(out[0] - np.cos(angle)).max() < 5e-15
    assert np.abs(out[1] - np.sin(angle)).max() < 5e-15
