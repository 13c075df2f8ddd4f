"""The mesh of refracted view rays under a relief."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skinrender.estimate.film_plane import make_film_plane
from skinrender.estimate.ray_mesh import entering_ray, find_rays, make_ray_mesh, mean_of_quadratic
from skinrender.scene.load import make_scene
from skinrender.transport.fresnel import fresnel, refract
from tests.maps import slab_data, slab_layer

SIZE = (1.0, 1.0)
BOX = np.array([-2.0, -2.0, 3.0, 3.0])
ETA = 1.0 / 1.4
WAVES = 0.03 * np.cos(2 * np.pi * np.arange(16) / 16)[:, None] * np.cos(4 * np.pi * np.arange(16) / 16)[None, :]
CAMERAS = [{}, {"zenith_deg": 45, "azimuth_deg": 70}, {"kind": "perspective", "distance_mm": 5}]


def film_of(camera: dict):
    data = slab_data([slab_layer(1.0, 0.1, 10.0, 0.8, 1.4)], {"kind": "collimated"}, 1.0)
    return make_film_plane(make_scene({**data, "camera": {"pixels": [8, 8], **camera}}).camera, SIZE)


def rays_through(mesh, point) -> np.ndarray:
    stack, found = np.zeros((100, 3), np.int64), np.zeros((64, 4))
    return found[: find_rays(mesh, *point, stack, found)].copy()


def refracted(film, heights, a: float, b: float) -> tuple[float, np.ndarray]:
    h, ux, uy, uz, nx, ny, nz, cos_i, _ = entering_ray(film, heights, *SIZE, a, b)
    return h, np.array(refract(ux, uy, uz, nx, ny, nz, ETA, cos_i, fresnel(cos_i, ETA)[1]))


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_lead_to_the_point(camera):
    film = film_of(camera)
    mesh = make_ray_mesh(film, WAVES, SIZE, ETA, BOX, 8)
    rng = np.random.default_rng(3)
    for point in np.column_stack([rng.uniform(0.0, 1.0, (50, 2)), rng.uniform(0.05, 0.3, 50)]):
        found = rays_through(mesh, point)
        assert len(found) % 2 == 1  # folds come in pairs
        for a, b, z, _ in found:
            h, direction = refracted(film, WAVES, a, b)
            assert z == pytest.approx(h, abs=mesh.sag_mm)
            assert np.allclose([a, b, h] + direction * ((point[2] - h) / direction[2]), point, atol=2e-4)


def test_finds_every_ray_that_a_dense_search_finds():
    film = film_of(CAMERAS[1])
    mesh = make_ray_mesh(film, 2 * WAVES, SIZE, ETA, BOX, 8)
    x, y = np.meshgrid(mesh.x, mesh.y, indexing="ij")
    folded = 0
    for point in np.column_stack([np.random.default_rng(5).uniform(0.0, 1.0, (40, 2)), np.full(40, 0.6)]):
        offset = np.stack([x, y], axis=-1) + (point[2] - mesh.node[..., :1]) * mesh.node[..., 1:] - point[:2]
        angle = np.arctan2(offset[..., 1], offset[..., 0])
        corners = [angle[:-1, :-1], angle[1:, :-1], angle[1:, 1:], angle[:-1, 1:]]
        turns = sum((b - a + math.pi) % (2 * math.pi) - math.pi for a, b in zip(corners, corners[1:] + corners[:1]))
        cells = int((np.abs(turns) > 3.0).sum())
        found = rays_through(mesh, point)
        assert len(found) >= cells
        assert (len(found) - cells) % 2 == 0
        folded += len(found) > 1
    assert folded > 5


@pytest.mark.parametrize("height", [1.0, 2.0])
def test_area_is_kept(height):
    """Rays of one tile cross a plane in one tile's area, all sheets of a fold counted: the mean of their spreads is 1."""
    film = film_of(CAMERAS[1])
    mesh = make_ray_mesh(film, height * WAVES, SIZE, ETA, BOX, 4)
    rng = np.random.default_rng(8)
    spread = [rays_through(mesh, (*rng.uniform(0.0, 1.0, 2), rng.uniform(0.2, 0.6)))[:, 3].sum() for _ in range(20000)]
    error = np.std(spread) / math.sqrt(len(spread))
    assert abs(np.mean(spread) - 1.0) < 4 * error
    assert error < 0.02


def test_flat_surface_has_one_ray_and_no_spread():
    film = film_of(CAMERAS[2])
    mesh = make_ray_mesh(film, np.zeros((4, 4)), SIZE, ETA, BOX, 2)
    found = rays_through(mesh, (0.3, 0.6, 0.2))
    assert found.shape == (1, 4)
    _, direction = refracted(film, np.zeros((4, 4)), *found[0, :2])
    assert np.allclose(found[0, :2] + direction[:2] * (0.2 / direction[2]), [0.3, 0.6], atol=1e-4)


@pytest.mark.parametrize("coefficients", [(1, 0, 0), (1, -3, 1), (-0.2, 0.1, 2), (0.5, -2, 2), (0, 0, 0), (1, -2, 0), (1e-9, -1, 1e-12)])
def test_mean_of_quadratic(coefficients):
    t = (np.arange(100_000) + 0.5) / 100_000
    c, b, a = map(float, coefficients)
    assert mean_of_quadratic(c, b, a) == pytest.approx(np.abs(c + b * t + a * t * t).mean(), abs=1e-8)
