"""Optical depth through voxels against dense sampling, and the edge cases of the traversal."""

import numpy as np
import pytest

from skinrender.transport.optical_depth import add_optical_depth

LX, LY = 2.0, 1.0
EDGES = np.array([0.0, 0.1, 0.15, 0.5, 1.2])
RNG = np.random.default_rng(4)
PALETTE = RNG.integers(0, 5, (4, 3, 4)).astype(np.uint16)
MU_T = RNG.uniform(0.1, 5.0, (5, 2))


def depth(start, direction, length):
    tau = np.zeros(2)
    add_optical_depth(PALETTE, EDGES, LX, LY, MU_T, *map(float, start), *map(float, direction), length, tau)
    return tau


def sampled(start, direction, length, n=200_000):
    s = (np.arange(n) + 0.5) * (length / n)
    p = np.asarray(start) + s[:, None] * np.asarray(direction)
    i = np.floor(p[:, 0] / LX * 4).astype(int) % 4
    j = np.floor(p[:, 1] / LY * 3).astype(int) % 3
    k = np.clip(np.searchsorted(EDGES, p[:, 2], side="right") - 1, 0, 3)
    return MU_T[PALETTE[i, j, k]].mean(axis=0) * length


@pytest.mark.parametrize("seed", range(12))
def test_agrees_with_dense_sampling(seed):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform((-2, -1, 0), (4, 2, 1.2)), rng.uniform((-2, -1, 0), (4, 2, 1.2))
    length = float(np.linalg.norm(end - start))
    direction = (end - start) / length
    assert depth(start, direction, length) == pytest.approx(sampled(start, direction, length), rel=1e-3)
    assert depth(start, direction, length) == pytest.approx(depth(end, -direction, length), rel=1e-12)


def test_vertical_flight_adds_the_planes_of_its_column():
    expected = np.diff(EDGES) @ MU_T[PALETTE[1, 2]]
    assert depth((0.6, 0.8, 0.0), (0, 0, 1), 1.2) == pytest.approx(expected)
    assert depth((0.6, 0.8, 1.2), (0, 0, -1), 1.2) == pytest.approx(expected)


def test_flight_along_edges_and_through_corners_keeps_its_length():
    uniform = np.full((4, 3, 4), 2, np.uint16)
    for direction in [(1, 0, 0), (0, -1, 0), (0.6, 0.8, 0), (0.5, 1 / 3, 0)]:
        d = np.array(direction, float) / np.linalg.norm(direction)
        tau = np.zeros(2)
        add_optical_depth(uniform, EDGES, LX, LY, MU_T, 0.5, 1 / 3, 0.1, *d, 7.0, tau)
        assert tau == pytest.approx(7.0 * MU_T[2])


def test_no_length_adds_nothing():
    assert np.all(depth((0.5, 0.5, 0.1), (0, 0, 1), 0.0) == 0.0)
