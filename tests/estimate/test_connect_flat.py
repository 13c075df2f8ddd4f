"""The connection of a photon to the camera through flat refracting borders, against rays traced the other way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skinrender.estimate.connect_flat import (
    Tissue,
    connect_flat,
    deposit_flat,
    lateral_reach,
    solve_snell,
    survives,
    transmission_to,
)
from skinrender.estimate.film_plane import make_film_plane, pixel_of_point
from skinrender.film.camera import view_rays
from skinrender.scene.load import make_scene
from tests.direct_sum import directions, henyey_greenstein
from tests.maps import slab_data, slab_layer

BORDERS = np.array([0.0, 0.1, 0.5])
INDEX = np.array([1.0, 1.5, 1.33, 1.6])
SIZE = (2.0, 2.0)
CAMERAS = {
    "above": {"pixels": [40, 40]},
    "aslant": {"pixels": [40, 40], "zenith_deg": 50, "azimuth_deg": 70},
    "perspective": {"pixels": [40, 40], "kind": "perspective", "distance_mm": 4, "zenith_deg": 20, "azimuth_deg": 30},
}


def camera_of(name: str):
    data = slab_data([slab_layer(1.0, 0.1, 10.0, 0.8, 1.4)], {"kind": "collimated"})
    return make_scene({**data, "camera": CAMERAS[name]}).camera


def trace(origin: np.ndarray, direction: np.ndarray, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where view rays (..., 3) get to at depth z, their directions there, and their transmissions / n^2, by Snell's
    law."""
    point, u, n, passed = origin, direction, 1.0, 1.0
    for top, index in zip(BORDERS, INDEX[1:]):
        if top >= z:
            break
        point = point + u * ((top - point[..., 2:]) / u[..., 2:])
        sideways, cosine = u[..., :2] * n / index, u[..., 2]
        below = np.sqrt(1.0 - (sideways**2).sum(axis=-1))
        s = (n * cosine - index * below) / (n * cosine + index * below)
        p = (index * cosine - n * below) / (index * cosine + n * below)
        passed = passed * (1.0 - 0.5 * (s * s + p * p))
        u, n = np.concatenate([sideways, below[..., None]], axis=-1), index
    return point + u * ((z - point[..., 2:]) / u[..., 2:]), u, passed / n**2


@pytest.mark.parametrize("lateral", [0.0, 1e-9, 0.3, 5.0, 200.0])
@pytest.mark.parametrize("index", [INDEX, INDEX[::-1].copy(), np.ones(4)])
def test_snell_invariant_leads_to_the_point(lateral, index):
    p = solve_snell(lateral, 2.0, 0.7, 2, BORDERS, index)
    outside, inside, slope = lateral_reach(p, 2.0, 0.7, 2, BORDERS, index)
    assert 0.0 <= p < index.min()
    assert p * (outside + inside) == pytest.approx(lateral, abs=1e-9, rel=1e-6)
    step = 1e-6 * (index.min() - p)
    reach = [q * sum(lateral_reach(q, 2.0, 0.7, 2, BORDERS, index)[:2]) for q in (p, p + step)]
    assert slope == pytest.approx((reach[1] - reach[0]) / step, rel=1e-3)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("z", [0.04, 0.3, 0.9])
def test_the_way_back_from_the_end_of_a_ray(name, z):
    camera = camera_of(name)
    film = make_film_plane(camera, SIZE)
    rays = view_rays(camera, SIZE)
    region = int(np.searchsorted(BORDERS, z, side="right")) - 1
    for row, column in ((0, 0), (7, 33), (20, 20), (39, 3)):
        origin, direction = rays.origin[row, column], rays.direction[row, column]
        end, inside, passed = trace(origin, direction, z)
        entry = origin - direction * (origin[2] / direction[2])
        x, y, ex, ey, p, area = connect_flat(film, *end, region, BORDERS, INDEX)
        assert (x, y) == pytest.approx(tuple(entry[:2]), abs=1e-9)
        assert pixel_of_point(film, x, y, 0.0) == row * 40 + column
        factor, cosine = transmission_to(p, region, INDEX)
        assert factor == pytest.approx(passed, rel=1e-9)
        assert cosine == pytest.approx(inside[2], rel=1e-9)
        assert np.allclose([ex * p / INDEX[region + 1], ey * p / INDEX[region + 1]], inside[:2], atol=1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_area_is_that_of_the_pixel_at_depth(name):
    camera, z, fine = camera_of(name), 0.9, 10
    film, rays = make_film_plane(camera, SIZE), view_rays(camera_of(name), SIZE, fine)
    for row, column in ((10, 10), (200, 200), (350, 15)):
        corners = [
            trace(rays.origin[row + i, column + j], rays.direction[row + i, column + j], z)[0]
            for i, j in ((0, 0), (1, 0), (0, 1))
        ]
        area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) * fine**2
        assert connect_flat(film, *corners[0], 2, BORDERS, INDEX)[5] * area == pytest.approx(1.0, rel=2e-3)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_handful_of_photons_by_hand(name):
    """What each photon adds, found by looking for its pixel among all view rays."""
    camera, fine = camera_of(name), 4
    film, rays = make_film_plane(camera, SIZE), view_rays(camera, SIZE, fine)
    rng = np.random.default_rng(4)
    z = np.array([0.03, 0.2, 0.45, 0.8])
    position = np.column_stack([rng.uniform(0.8, 1.2, (4, 2)), z]).astype(np.float32)
    code = rng.integers(0, 65535, (4, 2)).astype(np.uint16)
    mu_t, g = np.array([[3.0], [5.0], [2.0]]), np.array([0.6, 0.0, -0.3])
    palette = np.array([[[0, 1, 2]]], np.uint16)
    tissue = Tissue(palette, np.append(BORDERS, 1.0), mu_t, g, 2.0, np.inf)
    image = np.zeros(1600, np.float32)
    box = np.array([-5.0, -5.0, 5.0, 5.0])
    deposit_flat(
        position, code, 0, 4, None, *SIZE, False, tissue, film, box, np.zeros(4), BORDERS, INDEX, 0.0, 0, image
    )
    expected = np.zeros(1600)
    for k in range(4):
        points, inside, passed = trace(rays.origin, rays.direction, z[k])
        row, column = np.unravel_index(((points - position[k]) ** 2).sum(axis=2).argmin(), points.shape[:2])
        inside, passed = inside[row, column], passed[row, column]
        edges = points[row + 1, column] - points[row, column], points[row, column + 1] - points[row, column]
        area = np.linalg.norm(np.cross(*edges)) * fine**2
        region, tau = int(np.searchsorted(BORDERS, z[k], side="right")) - 1, 0.0
        origin, direction = rays.origin[row, column], rays.direction[row, column]
        for r in range(region + 1):
            bottom = z[k] if r == region else BORDERS[r + 1]
            tau += mu_t[r, 0] * (bottom - BORDERS[r]) / trace(origin, direction, 0.5 * (BORDERS[r] + bottom))[1][2]
        phase = henyey_greenstein(-directions(code[k : k + 1])[0] @ inside, g[region])
        expected[row // fine * 40 + column // fine] += phase * passed * math.exp(-tau) / (area * inside[2])
    assert np.array_equal(np.flatnonzero(image), np.flatnonzero(expected))
    assert np.allclose(image, expected, rtol=0.02)


def test_chance_makes_up_for_what_it_drops():
    value, least = 0.3, 2.0
    chances = np.array([survives(value, least, i, k) for i in range(4000) for k in range(5)])
    assert set(np.unique(chances)) == {0.0, value / least}
    kept = (chances > 0).mean()
    assert abs(kept - value / least) < 4 * math.sqrt(0.15 * 0.85 / chances.size)
    assert survives(2.5, least, 3, 0) == 1.0
