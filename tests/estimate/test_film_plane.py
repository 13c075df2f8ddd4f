"""The camera as the reference estimate reads it, against the rays of the film's own camera."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.estimate.film_plane import (
    footprint_mm,
    make_film_plane,
    pixel_of_point,
    pixels_per_area,
    view_direction,
)
from skinrender.film.camera import view_rays
from skinrender.scene.load import make_scene
from tests.maps import slab_data, slab_layer

SIZE = (2.0, 3.0)
CAMERAS = [
    {"zenith_deg": 40, "azimuth_deg": 25, "window_mm": [1.5, 1.2]},
    {"kind": "perspective", "distance_mm": 7, "zenith_deg": 30, "azimuth_deg": 200, "center_mm": [0.2, 0.3]},
]


@pytest.fixture(params=CAMERAS, ids=["parallel", "perspective"])
def camera(request):
    data = slab_data([slab_layer(1.0, 0.1, 10.0, 0.8, 1.4)], {"kind": "collimated"})
    return make_scene({**data, "camera": {"pixels": [7, 5], **request.param}}).camera


def test_a_point_on_the_ray_of_a_pixel_is_seen_in_it(camera):
    film = make_film_plane(camera, SIZE)
    rays = view_rays(camera, SIZE, subpixels=3)
    for row in range(15):
        for column in range(21):
            point = rays.origin[row, column] + rays.direction[row, column] * 3.7
            assert pixel_of_point(film, *point) == row // 3 * 7 + column // 3
            assert np.allclose(view_direction(film, *point)[:3], rays.direction[row, column], atol=1e-12)


def test_points_beside_the_picture_are_seen_in_no_pixel(camera):
    film = make_film_plane(camera, SIZE)
    start = np.array([film.x, film.y, film.z]) + film.axis
    for offset in (film.right, -film.right, film.down, -film.down):
        assert pixel_of_point(film, *(start + 3.0 * offset)) == -1


def test_area_of_pixels(camera):
    """A cone of rays through a small part of the picture, cut perpendicular to its middle ray."""
    film = make_film_plane(camera, SIZE)
    fine = 40
    rays = view_rays(camera, SIZE, fine)
    row, column = 3 * fine // 2, 11 * fine // 2
    middle = rays.direction[row, column]
    at = rays.origin[row, column] + middle * 5.0
    corners = []
    for i, j in ((0, 0), (1, 0), (0, 1)):
        origin, direction = rays.origin[row + i, column + j], rays.direction[row + i, column + j]
        corners.append(origin + direction * (((at - origin) @ middle) / (direction @ middle)))
    area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) * fine**2
    assert pixels_per_area(film, *view_direction(film, *at)) * area == pytest.approx(1.0, rel=1e-3)


def test_footprint_holds_where_the_rays_meet_the_skin(camera):
    film = make_film_plane(camera, SIZE)
    box = footprint_mm(film, -0.2, 0.3)
    rays = view_rays(camera, SIZE, subpixels=5)
    for z in (-0.2, 0.1, 0.3):
        points = rays.origin + rays.direction * ((z - rays.origin[..., 2:]) / rays.direction[..., 2:])
        low, high = points[..., :2].min(axis=(0, 1)), points[..., :2].max(axis=(0, 1))
        assert (box[:2] <= low).all() and (high <= box[2:]).all()
        assert (low - box[:2] < 1.0).all() and (box[2:] - high < 1.0).all()
