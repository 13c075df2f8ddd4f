"""The height field against planes, a sphere, brute force, and the edge cases of a flight through cells."""

import math

import numpy as np
import pytest

from skinrender.transport.height_field import cell_bounds, first_hit, height, height_and_gradient, slab_interval

LX, LY = 3.0, 2.0


def centers(hx, hy, lx=LX, ly=LY):
    return np.meshgrid((np.arange(hx) + 0.5) * lx / hx, (np.arange(hy) + 0.5) * ly / hy, indexing="ij")


def rough(hx=24, hy=16, amplitude=0.1, seed=3):
    return np.random.default_rng(seed).normal(0.0, amplitude, (hx, hy))


def hit(heights, start, direction, s_max, side, lx=LX, ly=LY):
    direction = np.asarray(direction, float)
    return first_hit(
        heights, cell_bounds(heights), lx, ly, *start, *(direction / np.linalg.norm(direction)), s_max, side
    )


def brute_force(heights, start, direction, s_max, side, steps=4000):
    """First sign change on a fine grid, then bisection."""

    def f(s):
        x, y, z = start + s * direction
        return side * (z - height(heights, LX, LY, x, y))

    s = np.linspace(0.0, s_max, steps)
    negative = np.flatnonzero([f(v) < 0.0 for v in s])
    if negative.size == 0:
        return -1.0
    lo, hi = s[negative[0] - 1], s[negative[0]]
    for _ in range(60):
        mid = 0.5 * (lo + hi)
        lo, hi = (lo, mid) if f(mid) < 0.0 else (mid, hi)
    return lo


def test_constant_control_points_give_a_plane():
    z, slope_x, slope_y = height_and_gradient(np.full((5, 7), -0.3), LX, LY, 1.234, 0.77)
    assert z == pytest.approx(-0.3, abs=1e-15)
    assert (slope_x, slope_y) == pytest.approx((0.0, 0.0), abs=1e-14)


def test_tilted_plane_is_reproduced_away_from_the_seam():
    x, y = centers(12, 10)
    heights = 0.2 * x - 0.1 * y + 0.05
    for px, py in [(0.8, 0.7), (1.5, 1.0), (2.2, 1.33)]:
        assert height_and_gradient(heights, LX, LY, px, py) == pytest.approx((0.2 * px - 0.1 * py + 0.05, 0.2, -0.1))


def test_height_is_periodic():
    heights = rough()
    expected = height(heights, LX, LY, 0.4, 1.7)
    for k, m in [(-3, 2), (5, -1), (100, 100)]:
        assert height(heights, LX, LY, 0.4 + k * LX, 1.7 + m * LY) == pytest.approx(expected, abs=1e-12)


def test_height_and_slopes_are_continuous_over_cell_borders_and_the_seam():
    heights = rough()
    for x, y in [(0.0, 0.33), (LX / 24 * 7, 0.5), (1.0, LY / 16 * 5), (1.0, LY)]:
        before = height_and_gradient(heights, LX, LY, x - 1e-12, y - 1e-12)
        after = height_and_gradient(heights, LX, LY, x + 1e-12, y + 1e-12)
        assert before == pytest.approx(after, abs=1e-9)


def test_slopes_are_the_derivatives_of_the_height():
    heights, d = rough(), 1e-6
    for x, y in np.random.default_rng(1).uniform(0.0, 2.0, (20, 2)):
        _, slope_x, slope_y = height_and_gradient(heights, LX, LY, x, y)
        assert slope_x == pytest.approx(
            (height(heights, LX, LY, x + d, y) - height(heights, LX, LY, x - d, y)) / (2 * d), abs=1e-6
        )
        assert slope_y == pytest.approx(
            (height(heights, LX, LY, x, y + d) - height(heights, LX, LY, x, y - d)) / (2 * d), abs=1e-6
        )


def test_normal_of_a_spherical_dent_converges_at_second_order():
    def largest_slope_error(n):
        x, y = centers(n, n, 2.0, 2.0)
        heights = np.sqrt(9.0 - (x - 1.0) ** 2 - (y - 1.0) ** 2)
        errors = []
        for px, py in np.random.default_rng(5).uniform(0.5, 1.5, (200, 2)):
            z = math.sqrt(9.0 - (px - 1.0) ** 2 - (py - 1.0) ** 2)
            _, slope_x, slope_y = height_and_gradient(heights, 2.0, 2.0, px, py)
            errors.append(math.hypot(slope_x + (px - 1.0) / z, slope_y + (py - 1.0) / z))
        return max(errors)

    assert largest_slope_error(20) / largest_slope_error(80) > 12.0


def test_bounds_hold_the_surface():
    heights = rough(6, 4)
    bounds = cell_bounds(heights)
    for x, y in np.random.default_rng(2).uniform(0.0, 1.0, (500, 2)) * (LX, LY):
        i, j = int(x / LX * 6), int(y / LY * 4)
        assert bounds[i, j, 0] <= height(heights, LX, LY, x, y) <= bounds[i, j, 1]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_first_hit_agrees_with_brute_force(side):
    heights, rng = rough(), np.random.default_rng(7)
    bounds = cell_bounds(heights)
    found = 0
    for _ in range(300):
        start = np.array([rng.uniform(-1, 4), rng.uniform(-1, 3), 0.0])
        start[2] = height(heights, LX, LY, start[0], start[1]) + side * rng.exponential(0.1)
        direction = rng.normal(size=3) * (1.0, 1.0, 0.3)
        direction /= np.linalg.norm(direction)
        s = first_hit(heights, bounds, LX, LY, *start, *direction, 2.0, side)
        expected = brute_force(heights, start, direction, 2.0, side)
        if expected < 0.0 <= s:  # the grid stepped over a sliver: then the crossing itself must be there
            x, y, z = start + s * direction
            assert abs(z - height(heights, LX, LY, x, y)) < 1e-10
        else:
            assert s == pytest.approx(expected, abs=1e-8)
        found += s > 0.0
    assert found > 100


def test_hit_lies_on_the_surface_and_crosses_from_its_side():
    heights, rng = rough(amplitude=0.5), np.random.default_rng(8)
    bounds = cell_bounds(heights)
    for _ in range(300):
        x, y = rng.uniform(0.0, 2.0, 2)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        s = first_hit(heights, bounds, LX, LY, x, y, 4.0, *direction, 20.0, 1.0)
        if s >= 0.0:
            p = np.array([x, y, 4.0]) + s * direction
            z, slope_x, slope_y = height_and_gradient(heights, LX, LY, p[0], p[1])
            assert abs(p[2] - z) < 1e-10
            assert direction @ (-slope_x, -slope_y, 1.0) < 0.0
        else:
            assert direction[2] > -0.5


def test_start_on_the_surface_does_not_return_itself():
    heights, rng = rough(amplitude=0.3), np.random.default_rng(9)
    bounds = cell_bounds(heights)
    for _ in range(500):
        x, y = rng.uniform(0.0, 2.0, 2)
        side = rng.choice([-1.0, 1.0])
        z, slope_x, slope_y = height_and_gradient(heights, LX, LY, x, y)
        inward = np.array([-slope_x, -slope_y, 1.0])
        direction = rng.normal(size=3)
        direction *= side * np.sign(direction @ inward) / np.linalg.norm(direction)
        leaving = abs(direction @ inward)
        s = first_hit(heights, bounds, LX, LY, x, y, z + rng.choice([-1e-10, 0.0, 1e-10]), *direction, 1.0, side)
        assert s == -1.0 or s > 1e-4 * leaving


def test_start_on_the_surface_towards_the_other_side_crosses_at_once():
    heights = rough()
    z = height(heights, LX, LY, 0.7, 0.7)
    assert 0.0 <= hit(heights, (0.7, 0.7, z), (0, 0, 1), 1.0, -1.0) < 1e-9


def test_start_beyond_the_surface_is_reported_as_zero():
    assert hit(np.zeros((3, 3)), (0.5, 0.5, -0.1), (1, 0, 0), 1.0, 1.0) == 0.0


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (8, 8)])
def test_flat_surface(shape):
    heights = np.full(shape, 0.25)
    assert hit(heights, (0.5, 0.5, -1.0), (0, 0, 1), 5.0, -1.0) == pytest.approx(1.25, abs=1e-10)
    assert hit(heights, (0.5, 0.5, 1.25), (3, 0, -4), 5.0, 1.0) == pytest.approx(1.25, abs=1e-10)
    assert hit(heights, (0.5, 0.5, 1.25), (3, 0, -4), 1.2, 1.0) == -1.0
    assert hit(heights, (0.5, 0.5, 1.25), (1, 1, 0), 50.0, 1.0) == -1.0
    for offset in (-1e-9, 0.0, 1e-9):
        assert hit(heights, (0.5, 0.5, 0.25 + offset), (1, 0.1, 0), 50.0, 1.0) == -1.0
        assert hit(heights, (0.5, 0.5, 0.25 + offset), (1, 0.1, -1e-3), 50.0, -1.0) == -1.0


def test_flights_along_cell_borders_and_through_corners():
    heights = rough(3, 2, 0.2)
    for direction in [
        (1, 0, 0),
        (-1, 0, 0),
        (0, 1, 0),
        (0, -1, 0),
        (1, 1, 0),
        (-1, -1, 0),
        (1, 1, 0.05),
        (-1, 1, -0.05),
    ]:
        unit = np.array(direction) / np.linalg.norm(direction)
        start = np.array([1.0, 1.0, height(heights, LX, LY, 1.0, 1.0) + 0.02])
        s = hit(heights, start, unit, 6.0, 1.0)
        assert s == pytest.approx(brute_force(heights, start, unit, 6.0, 1.0), abs=1e-7)


def test_vertical_flight_from_both_sides():
    heights = rough()
    z = height(heights, LX, LY, 1.0, 1.0)
    assert hit(heights, (1.0, 1.0, -5.0), (0, 0, 1), 9.0, -1.0) == pytest.approx(5.0 + z, abs=1e-10)
    assert hit(heights, (1.0, 1.0, 5.0), (0, 0, -1), 9.0, 1.0) == pytest.approx(5.0 - z, abs=1e-10)


def test_a_thin_ridge_is_not_stepped_over():
    heights = np.zeros((30, 3))
    heights[15, :] = -1.0
    peak = height(heights, LX, LY, 15.5 * LX / 30, 1.0)
    s = hit(heights, (0.1, 1.0, peak + 1e-9), (1, 0, 0), 2.9, -1.0)
    assert s == pytest.approx(15.5 * LX / 30 - 0.1, abs=1e-4)


def test_float32_control_points_are_taken():
    heights = rough().astype(np.float32)
    assert hit(heights, (1.0, 1.0, -5.0), (0, 0, 1), 9.0, -1.0) == pytest.approx(
        5.0 + height(heights, LX, LY, 1.0, 1.0)
    )


def test_slab_interval():
    assert slab_interval(-10.0, 0.5, -1.0, 2.0, 100.0) == (18.0, 24.0)
    assert slab_interval(0.0, -1.0, -1.0, 2.0, 100.0) == (0.0, 1.0)
    assert slab_interval(0.0, 0.0, -1.0, 2.0, 7.0) == (0.0, 7.0)
    begin, end = slab_interval(-5.0, -1.0, -1.0, 2.0, 100.0)
    assert end < begin
