"""View rays: where they meet the mean plane, how the image is oriented, how it tilts."""

from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.film.camera import view_axes, view_rays

SIZE = (10.0, 8.0)


def camera(**changes):
    described = {
        "kind": "orthographic", "pixels": (5, 4), "center_mm": None, "window_mm": None,
        "zenith_deg": 0.0, "azimuth_deg": 0.0, "distance_mm": None,
    }  # fmt: skip
    return SimpleNamespace(**{**described, **changes})


def on_plane(rays):
    s = -rays.origin[..., 2] / rays.direction[..., 2]
    return rays.origin + s[..., None] * rays.direction


def test_orthographic_pixels_look_straight_down_at_their_centers():
    rays = view_rays(camera(), SIZE)
    assert rays.origin.shape == (4, 5, 3)
    assert np.all(rays.direction == (0.0, 0.0, 1.0))
    assert np.all(rays.origin[..., 2] < 0.0)
    assert on_plane(rays)[0, 0] == pytest.approx((1.0, 1.0, 0.0))
    assert on_plane(rays)[3, 1] == pytest.approx((3.0, 7.0, 0.0))


def test_perspective_window_covers_exactly_the_face():
    rays = view_rays(camera(kind="perspective", distance_mm=18.0, pixels=(200, 200)), (10.0, 10.0))
    hits = on_plane(rays)
    assert rays.origin[7, 9] == pytest.approx((5.0, 5.0, -18.0))
    assert hits[0, 0] == pytest.approx((0.025, 0.025, 0.0))
    assert hits[-1, -1] == pytest.approx((9.975, 9.975, 0.0))
    assert np.linalg.norm(rays.direction, axis=-1) == pytest.approx(1.0)


def test_subpixels_average_to_their_pixel():
    single = on_plane(view_rays(camera(), SIZE))
    fine = on_plane(view_rays(camera(), SIZE, subpixels=3))
    assert fine.shape == (12, 15, 3)
    assert fine.reshape(4, 3, 5, 3, 3).mean(axis=(1, 3)) == pytest.approx(single)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_tilt_keeps_the_center_and_stands_at_its_azimuth(kind):
    rays = view_rays(
        camera(kind=kind, distance_mm=50.0, pixels=(1, 1), center_mm=(2.0, 3.0), zenith_deg=60.0, azimuth_deg=90.0),
        SIZE,
    )
    assert on_plane(rays)[0, 0] == pytest.approx((2.0, 3.0, 0.0))
    assert rays.direction[0, 0] == pytest.approx((0.0, -np.sin(np.pi / 3), 0.5))
    assert rays.origin[0, 0, 1] > 3.0


def test_tilted_window_is_foreshortened():
    hits = on_plane(view_rays(camera(zenith_deg=60.0, pixels=(3, 3), window_mm=(3.0, 3.0)), SIZE))
    assert hits[1, 2] - hits[1, 1] == pytest.approx((2.0, 0.0, 0.0))
    assert hits[2, 1] - hits[1, 1] == pytest.approx((0.0, 1.0, 0.0))


def test_rays_start_above_the_skin_at_any_tilt():
    assert np.all(view_rays(camera(zenith_deg=89.9, azimuth_deg=30.0), SIZE).origin[..., 2] < -1.0)


@pytest.mark.parametrize(("zenith", "azimuth"), [(0.0, 77.0), (30.0, 0.0), (75.0, 200.0)])
def test_axes_are_orthonormal_and_right_handed(zenith, azimuth):
    matrix = np.array(view_axes(zenith, azimuth))
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_no_tilt_has_no_azimuth():
    assert np.array(view_axes(0.0, 123.0)) == pytest.approx(np.eye(3))


@pytest.mark.parametrize("changes", [{"kind": "perspective"}, {"zenith_deg": 90.0}])
def test_impossible_cameras_are_refused(changes):
    with pytest.raises(InputError):
        view_rays(camera(**changes), SIZE)
