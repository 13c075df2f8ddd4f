"""The power that each lamp aims at the patch, and how scenes describe lamps."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.photonmap.light import (
    CollimatedLight,
    PointLight,
    SkyLight,
    flight_direction,
    light_from_scene,
    rectangle_solid_angle,
)


def scene(**light):
    described = {"spectrum": "E", "position_mm": None, "zenith_deg": 0.0, "azimuth_deg": 0.0, "radius_mm": None}
    patch = SimpleNamespace(size_mm=(10.0, 8.0))
    return SimpleNamespace(
        light=SimpleNamespace(**{**described, **light}), patch=patch, wavelength_nm=(450.0, 550.0, 650.0),
        place=lambda key: None,
    )


def test_solid_angle_of_a_cube_face_from_its_center():
    assert rectangle_solid_angle(np.array([1.0, 1.0, -1.0]), (2.0, 2.0)) == pytest.approx(4.0 * math.pi / 6.0)


def test_solid_angle_is_additive_from_any_position():
    """Far off to the side too: against the sum over small cells of cos / d^2."""
    position = np.array([-3.0, 11.0, -2.0])
    x, y = np.meshgrid((np.arange(400) + 0.5) / 40.0, (np.arange(320) + 0.5) / 40.0)
    d2 = (x - position[0]) ** 2 + (y - position[1]) ** 2 + 4.0
    assert rectangle_solid_angle(position, (10.0, 8.0)) == pytest.approx(np.sum(2.0 / d2**1.5) / 1600.0, rel=1e-4)


def test_solid_angle_far_away_is_area_over_distance_squared():
    assert rectangle_solid_angle(np.array([0.5, 0.5, -1e4]), (1.0, 1.0)) == pytest.approx(1e-8, rel=1e-6)


def test_point_light_of_a_scene():
    light = light_from_scene(scene(kind="point", height_mm=100.0, intensity_W_per_sr=3.0))
    assert isinstance(light, PointLight)
    assert light.position_mm == pytest.approx((5.0, 4.0, -100.0))
    assert light.intensity == pytest.approx([1.0, 1.0, 1.0])
    omega = rectangle_solid_angle(light.position_mm, (10.0, 8.0))
    assert light.power_aimed_per_band((10.0, 8.0)).sum() == pytest.approx(3.0 * omega)


def test_collimated_light_falls_slanted_on_the_patch():
    light = light_from_scene(scene(kind="collimated", irradiance_W_per_mm2=1.0, zenith_deg=60.0))
    assert isinstance(light, CollimatedLight)
    assert light.direction == pytest.approx((-math.sqrt(0.75), 0.0, 0.5))
    assert light.power_aimed_per_band((10.0, 8.0)).sum() == pytest.approx(40.0)


def test_beam_and_pencil_carry_their_own_power():
    beam = light_from_scene(scene(kind="collimated", irradiance_W_per_mm2=2.0, radius_mm=1.0, zenith_deg=30.0))
    assert beam.power_aimed_per_band((10.0, 8.0)).sum() == pytest.approx(2.0 * math.pi)
    pencil = light_from_scene(scene(kind="collimated", irradiance_W_per_mm2=2.0, power_W=0.7, radius_mm=0.0))
    assert pencil.power_aimed_per_band((10.0, 8.0)).sum() == pytest.approx(0.7)


def test_a_beam_beyond_the_patch_is_refused():
    with pytest.raises(InputError, match="beyond the patch"):
        light_from_scene(
            scene(kind="collimated", irradiance_W_per_mm2=2.0, radius_mm=3.9, zenith_deg=60.0, azimuth_deg=90.0)
        )


def test_sky_light():
    light = light_from_scene(scene(kind="sky", radiance_W_per_mm2_sr=1.0))
    assert isinstance(light, SkyLight)
    assert light.power_aimed_per_band((10.0, 8.0)).sum() == pytest.approx(80.0 * math.pi)


def test_light_flies_down_from_its_azimuth():
    assert flight_direction(90.0, 90.0) == pytest.approx((0.0, -1.0, 0.0), abs=1e-15)
