"""The frame is orthonormal and right-handed for every direction, the turn keeps its angle."""

import math

import numpy as np
import pytest

from skinrender.transport.frame import frame, turn

AXES = [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (1e-12, 0, -1), (0, 0, -0.0 + 1)]


def directions():
    v = np.random.default_rng(1).normal(size=(100, 3))
    return [*AXES, *(v / np.linalg.norm(v, axis=1)[:, None])]


def test_frame_is_orthonormal_and_right_handed():
    for n in directions():
        f = frame(*map(float, n))
        matrix = np.array([f[:3], f[3:], n])
        assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-14)
        assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_turn_keeps_length_and_angle():
    rng = np.random.default_rng(2)
    for n in directions():
        u, phi = rng.uniform(0.0, 2.0), rng.uniform(0.0, 2.0 * math.pi)
        v = np.array(turn(*map(float, n), u, phi))
        assert v @ v == pytest.approx(1.0)
        assert v @ n == pytest.approx(1.0 - u)


def test_azimuth_is_uniform_about_the_axis():
    turned = np.array([turn(0.6, 0.0, -0.8, 0.7, phi) for phi in np.arange(12) * math.pi / 6])
    assert turned.mean(axis=0) == pytest.approx(np.array([0.6, 0.0, -0.8]) * 0.3)


def test_no_turn_keeps_the_direction():
    assert turn(0.0, 0.0, -1.0, 0.0, 1.0) == (0.0, 0.0, -1.0)
