"""Where the lamps' light falls and from which direction, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.photonmap.light import rectangle_solid_angle
from skinrender.transport import kernel, lanes
from skinrender.transport.emission import (
    COLLIMATED,
    KIND,
    POINT,
    collimated_parameters,
    emit,
    from_beam,
    from_point,
    from_sky,
    point_parameters,
    rectangle_constants,
    sky_parameters,
    spherical_rectangle,
    stratum,
)  # fmt: skip
from skinrender.transport.lanes import GROUP, LANES, new_block
from skinrender.transport.launch import seed
from skinrender.transport.rng import draw, stream_key
from tests.stats import assert_fits
from tests.transport.block import row

SIZE = (2.0, 1.0)


@kernel
def one_emitted(lamp, lx, ly, u, v, p, q):
    """(x, y, ux, uy, uz) of the lamp for given variates."""
    if lamp[KIND] == POINT:
        return from_point(lamp, u, v)
    if lamp[KIND] == COLLIMATED:
        return from_beam(lamp, lx, ly, u, v)
    return from_sky(lx, ly, u, v, p, q)


@kernel
def emitted(lamp, lx, ly, u, out):
    """Photons of the lamp for given variates (n, 4)."""
    for i in range(u.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = one_emitted(
            lamp, lx, ly, u[i, 0], u[i, 1], u[i, 2], u[i, 3]
        )


def photons(light, n=100_000, size=SIZE, seed=1):
    """Photons (n, 5), and where they meet the mean plane."""
    out = np.empty((n, 5))
    emitted(light, *size, np.random.default_rng(seed).random((n, 4)), out)
    assert np.isfinite(out).all()
    assert np.allclose((out[:, 2:] ** 2).sum(axis=1), 1.0, atol=1e-9)
    return out, out[:, :2]


def counts_on_patch(at, size=SIZE, bins=(21, 11)):
    counts = np.histogram2d(*at.T, bins=bins, range=[(0.0, size[0]), (0.0, size[1])])[0]
    assert counts.sum() == len(at)
    return counts


def solid_angle_shares(position, size=SIZE, bins=(21, 11)):
    """Share of the patch's solid angle in each cell, from the closed form for rectangles."""
    x, y = (np.linspace(0.0, length, n + 1) for length, n in zip(size, bins))
    shares = np.array(
        [
            [rectangle_solid_angle(position - [a, b, 0.0], (x[1] - x[0], y[1] - y[0])) for b in y[:-1]]
            for a in x[:-1]
        ]
    )
    return shares / rectangle_solid_angle(position, size)


LAMPS = {
    "far": ((1.0, 0.5, -100.0), SIZE),
    "near": ((0.3, 0.7, -0.2), SIZE),
    "aside": ((-3.0, 4.0, -2.0), SIZE),
    "above an edge": ((0.0, 0.5, -0.5), SIZE),
    "small patch": ((0.002, 0.02, -100.0), (0.01, 0.01)),
}


@pytest.mark.parametrize("name", LAMPS)
@pytest.mark.parametrize("z_mean", [0.0, 0.15])
def test_point_lamp_is_uniform_over_the_solid_angle_of_the_patch(name, z_mean):
    """On the patch that is a density of cos / distance^2."""
    position, size = LAMPS[name]
    lamp = point_parameters((*position[:2], position[2] + z_mean), size, z_mean)
    out, at = photons(lamp, size=size)
    assert_fits(counts_on_patch(at, size).ravel(), solid_angle_shares(np.array(position), size).ravel(), 2 * len(LAMPS))
    to_patch = np.concatenate([at, np.zeros((len(at), 1))], axis=1) - position
    assert np.allclose(out[:, 2:], to_patch / np.linalg.norm(to_patch, axis=1)[:, None], atol=1e-9)


def test_corners_of_the_square_are_the_corners_of_the_patch():
    constants = rectangle_constants(-0.3, -0.2, 1.7, 0.8, 5.0)
    for u, v in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)):
        assert spherical_rectangle(*constants, u, v) == pytest.approx((-0.3 + 2 * u, -0.2 + v), abs=1e-7)


@pytest.mark.parametrize("zenith", [0.0, 50.0, 89.0])
def test_collimated_light_is_uniform_over_the_patch(zenith):
    sin, cos = np.sin(np.radians(zenith)), np.cos(np.radians(zenith))
    direction = (0.6 * sin, -0.8 * sin, cos)
    out, at = photons(collimated_parameters((1.0, 0.5), direction, None))
    assert np.allclose(out[:, 2:], direction)
    assert_fits(counts_on_patch(at).ravel(), np.full(231, 1 / 231), 3)


def test_tilted_disc_is_uniform_across_the_beam():
    direction, radius = np.array([0.48, 0.64, 0.6]), 0.25
    out, at = photons(collimated_parameters((1.0, 0.5), direction, radius))
    from_axis = np.concatenate([at - [1.0, 0.5], np.zeros((len(at), 1))], axis=1)
    across = from_axis - (from_axis @ direction)[:, None] * direction
    distance = np.linalg.norm(across, axis=1)
    assert distance.max() <= radius * (1.0 + 1e-9)
    first = np.cross(direction, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    angle = np.arctan2(across @ np.cross(direction, first), across @ first)
    counts = np.histogram2d((distance / radius) ** 2, angle, bins=(11, 15), range=[(0, 1), (-np.pi, np.pi)])[0]
    assert_fits(counts.ravel(), np.full(165, 1 / 165))


def test_pencil_meets_the_mean_plane_in_its_point():
    _, at = photons(collimated_parameters((0.7, 0.2), (0.6, 0.0, 0.8), 0.0), n=100)
    assert np.allclose(at, [0.7, 0.2])


def test_sky_is_uniform_over_the_patch_and_cosine_distributed():
    out, at = photons(sky_parameters())
    assert_fits(counts_on_patch(at).ravel(), np.full(231, 1 / 231), 2)
    azimuth = np.arctan2(out[:, 3], out[:, 2])
    counts = np.histogram2d(out[:, 4] ** 2, azimuth, bins=(21, 15), range=[(0, 1), (-np.pi, np.pi)])[0]
    assert_fits(counts.ravel(), np.full(315, 1 / 315), 2)


def test_lamps_of_given_variates():
    def one(light, *u):
        return one_emitted(light, *SIZE, *u)

    assert one(sky_parameters(), 0.25, 0.5, 0.36, 0.25) == pytest.approx([0.5, 0.5, 0.0, 0.6, 0.8])
    disc = collimated_parameters((1.0, 0.5), (0.0, 0.0, 1.0), 0.4)
    assert one(disc, 0.25, 0.25, 0.9, 0.9) == pytest.approx([1.0, 0.7, 0.0, 0.0, 1.0])
    overhead = point_parameters((1.0, 0.5, -3.0), SIZE, 0.0)
    assert one(overhead, 0.5, 0.5, 0.9, 0.9) == pytest.approx([1.0, 0.5, 0.0, 0.0, 1.0], abs=1e-9)


@kernel
def tiled(count, tiles_x, tiles_y, u, out):
    for i in range(count):
        out[i, 0], out[i, 1] = stratum(np.float64(i), count, tiles_x, tiles_y, u[i, 0], u[i, 1])


@pytest.mark.parametrize("count, tiles", [(7, (3, 2)), (1000, (3, 2)), (60_000, (4, 5)), (999, (1, 1)), (10, (20, 20))])
def test_histories_are_spread_evenly_in_tiles(count, tiles):
    at = np.concatenate([one_spread(count, tiles, seed) for seed in range(max(1, 60_000 // count))])
    assert np.all((at >= 0.0) & (at <= 1.0))
    assert_fits(np.histogram2d(*at.T, bins=(9, 9), range=[(0, 1), (0, 1)])[0].ravel(), np.full(81, 1 / 81), 5)


def one_spread(count, tiles, seed):
    out = np.empty((count, 2))
    tiled(count, *tiles, np.random.default_rng(seed).random((count, 2)), out)
    return out


def test_consecutive_histories_share_a_tile():
    tile = np.floor(one_spread(1200, (3, 2), 1) * [3, 2]).astype(int)
    number = tile[:, 0] + 3 * tile[:, 1]
    assert np.array_equal(number, np.repeat(np.arange(6), 200))


LIGHTS = {
    "point": point_parameters((0.3, 0.7, -5.0), SIZE, 0.1),
    "disc": collimated_parameters((1.0, 0.5), (0.6, 0.0, 0.8), 0.3),
    "beam": collimated_parameters((1.0, 0.5), (0.6, 0.0, 0.8), None),
    "sky": sky_parameters(),
}


@pytest.mark.parametrize("lamp", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("real, tolerance", [(np.float32, 1e-6), (np.float64, 1e-12)])
def test_lanes_are_emitted_by_their_own_variates(lamp, real, tolerance):
    first, count, tiles = 700, 2000, (3, 2)
    f, w = new_block(real)
    seed(w, LANES, stream_key(1, 2, 3), first)
    words = w.copy()
    emit(f, w, LANES, first, count, *tiles, lamp, *SIZE)
    for i in range(0, LANES, 17):
        u, v = stratum(float(first + i), count, *tiles, *(draw(words, i, LANES) for _ in range(2)))
        p, q = (draw(words, i, LANES) for _ in range(2)) if lamp == sky_parameters() else (0.0, 0.0)
        found = [row(f, start)[i] for start in (lanes.X, lanes.Y, lanes.UX, lanes.UY, lanes.UZ)]
        assert found == pytest.approx(one_emitted(lamp, *SIZE, u, v, p, q), abs=tolerance)
    assert np.array_equal(w[: 4 * LANES].reshape(4, -1)[:, ::17], words[: 4 * LANES].reshape(4, -1)[:, ::17])


@pytest.mark.parametrize("lamp", LIGHTS.values(), ids=LIGHTS)
def test_a_history_is_emitted_the_same_in_any_lane(lamp):
    """Bit for bit, in a block of any number of groups."""
    seen = []
    for first, n in ((700, LANES), (700 + 3 * GROUP, GROUP), (700 + GROUP + 7, 3 * GROUP)):
        f, w = new_block(np.float32)
        seed(w, n, stream_key(1, 2, 3), first)
        emit(f, w, n, first, 2000, 3, 2, lamp, *SIZE)
        lane = 3 * GROUP + 700 - first
        starts = (lanes.X, lanes.Y, lanes.UX, lanes.UY, lanes.UZ)
        seen.append([row(f, start)[lane : lane + GROUP - 7].tobytes() for start in starts])
    assert seen[0] == seen[1] == seen[2]
