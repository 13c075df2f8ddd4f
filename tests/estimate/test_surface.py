"""Surface reflection: normalization of the facets, reciprocity, shadows, and the unshadowed irradiance."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.estimate.surface import irradiance, microfacet, surface_reflection
from skinrender.estimate.view_path import make_view_path
from skinrender.photonmap.light import CollimatedLight, PointLight, SkyLight, flight_direction
from skinrender.skin.volume import SkinVolume
from skinrender.transport.fresnel import fresnel

SIZE = (10.0, 10.0)
SKIN = SimpleNamespace(roughness=0.35, oil=0.0)


def block(n=1.4, surface=None, sides="periodic"):
    return SkinVolume(
        palette_index=np.ones((1, 1, 1), np.uint16), z_edges_mm=np.array([0.0, 1.0]),
        palette_layer=np.array([0, 1], np.uint8), palette_melanin=np.zeros(2, np.float32),
        mu_a=np.ones((2, 2)), mu_s=np.ones((2, 2)), g=np.zeros((2, 2)),
        refractive_index=np.array([[1.0, 1.0], [n, n + 0.02]]), wavelength_nm=np.array([550.0, 650.0]),
        layer_name=("air", "skin"), size_mm=SIZE, border_z_mm=np.array([0.0, 1.0]), n_outside=np.ones(2),
        n_below=np.ones(2), sides=sides, surface_mm=surface,
    )  # fmt: skip


def view(volume, zenith=0.0, azimuth=0.0, at=(5.0, 5.0)):
    direction = flight_direction(zenith, azimuth)
    return make_view_path(np.array([[*at, 0.0]]) - 30.0 * direction, direction[None], volume)


def sun(zenith=0.0, azimuth=0.0, radius=None):
    return CollimatedLight(flight_direction(zenith, azimuth), np.ones(2), radius, np.array([5.0, 5.0]))


def reflected(volume, light, zenith=0.0, azimuth=0.0, at=(5.0, 5.0), finish=SKIN):
    return surface_reflection(view(volume, zenith, azimuth, at), np.zeros(1, np.int32), volume, light, finish)[0]


@pytest.mark.parametrize("alpha", [0.1, 0.35, 1.0])
def test_projected_facets_fill_the_mean_plane(alpha):
    """Integral of D cos over the hemisphere is 1: seen straight on, D = 4 microfacet / G with G = 1 / (1 + Lambda)."""
    x, w = np.polynomial.legendre.leggauss(2000)
    cos_h = 0.5 * (x + 1.0)
    facets = []
    for c in cos_h:
        cos_l = 2.0 * c * c - 1.0
        tan2 = (1.0 - cos_l**2) / cos_l**2
        shadow = 1.0 + 0.5 * (math.sqrt(1.0 + alpha**2 * tan2) - 1.0)
        facets.append(4.0 * microfacet(1.0, abs(cos_l), c, alpha) * shadow)
    assert math.pi * np.sum(w * cos_h * facets) == pytest.approx(1.0, rel=1e-6)


def test_reflection_is_reciprocal():
    forth = reflected(block(), sun(50.0, 10.0), 20.0, 130.0) / math.cos(math.radians(50.0))
    back = reflected(block(), sun(20.0, 130.0), 50.0, 10.0) / math.cos(math.radians(20.0))
    assert forth == pytest.approx(back, rel=1e-10)


def test_mirror_direction_of_a_slight_roughness_is_the_brightest():
    finish = SimpleNamespace(roughness=0.05, oil=0.0)
    mirror = reflected(block(), sun(30.0, 0.0), 30.0, 180.0, finish=finish)
    assert np.all(mirror > 50.0 * reflected(block(), sun(30.0, 0.0), 10.0, 180.0, finish=finish))


def test_sky_equals_the_sum_of_its_suns():
    x, w = np.polynomial.legendre.leggauss(64)
    total = np.zeros(2)
    for cos_l, weight in zip(0.5 * (x + 1.0), 0.5 * w, strict=True):
        for azimuth in np.arange(32) * 11.25:
            zenith = math.degrees(math.acos(cos_l))
            total += weight * math.radians(11.25) * reflected(block(), sun(zenith, azimuth), 40.0, 0.0)
    assert reflected(block(), SkyLight(np.ones(2)), 40.0) == pytest.approx(total, rel=0.01)


def test_smooth_sky_reflects_by_fresnel():
    finish = SimpleNamespace(roughness=1e-3, oil=0.0)
    got = reflected(block(), SkyLight(np.full(2, 3.0)), 60.0, finish=finish)
    assert got == pytest.approx([3.0 * fresnel(0.5, 1.0 / n)[0] for n in (1.4, 1.42)], rel=1e-3)


def test_oil_is_a_share_of_the_reflection():
    def value(roughness, oil):
        return reflected(block(), sun(20.0), 20.0, 180.0, finish=SimpleNamespace(roughness=roughness, oil=oil))

    assert value(0.35, 0.25) == pytest.approx(0.75 * value(0.35, 0.0) + 0.25 * value(0.1, 0.0))
    assert np.all(value(0.35, 0.25) > value(0.35, 0.0))


def test_equal_indices_reflect_nothing():
    volume = replace(block(), refractive_index=np.ones((2, 2)))
    for light in (sun(20.0), SkyLight(np.ones(2)), PointLight(np.array([5.0, 5.0, -50.0]), np.ones(2))):
        assert np.all(reflected(volume, light) == 0.0)


def test_far_point_light_is_parallel_light():
    light = PointLight(np.array([5.0, 5.0, -1e6]), np.full(2, 1e12))
    assert reflected(block(), light, 20.0) == pytest.approx(reflected(block(), sun(), 20.0), rel=1e-5)


def test_each_tile_has_its_own_lamp():
    light = PointLight(np.array([2.0, 5.0, -20.0]), np.ones(2))
    assert reflected(block(), light, at=(13.0, 5.0)) == pytest.approx(
        reflected(block(), light, at=(3.0, 5.0)), rel=1e-9
    )


def test_constant_relief_is_the_flat_surface():
    relief = block(surface=np.zeros((8, 8), np.float32))
    for light in (sun(40.0), SkyLight(np.ones(2)), PointLight(np.array([2.0, 5.0, -20.0]), np.ones(2))):
        assert reflected(relief, light, 20.0, 90.0) == pytest.approx(reflected(block(), light, 20.0, 90.0), rel=1e-9)


def test_a_ridge_throws_a_shadow():
    surface = np.zeros((50, 4), np.float32)
    surface[25:27] = -2.0
    relief = block(surface=surface)
    assert np.all(reflected(relief, sun(60.0, 0.0), at=(3.0, 5.0)) == 0.0)
    assert np.all(reflected(relief, sun(60.0, 180.0), at=(3.0, 5.0)) > 0.0)
    open_sky, hidden = SkyLight(np.ones(2)), reflected(relief, SkyLight(np.ones(2)), 50.0, 180.0, at=(4.3, 5.0))
    assert np.all(hidden < reflected(block(), open_sky, 50.0, 180.0))


def test_relief_tilts_the_mean_facet():
    x = (np.arange(64) + 0.5) * 10.0 / 64
    surface = np.tile(np.where(x < 5.0, 0.1 * x, 1.0 - 0.1 * x)[:, None], (1, 4)).astype(np.float32)
    path = view(block(surface=surface), at=(2.5, 5.0))
    assert path.normal[0] == pytest.approx(np.array([0.1, 0.0, -1.0]) / math.sqrt(1.01), abs=1e-6)
    assert path.entry[0] == pytest.approx((2.5, 5.0, 0.25), abs=1e-6)
    assert path.direction[0] @ -path.normal[0] == pytest.approx(path.cos_inside[0])
    assert np.cross(path.direction[0], path.normal[0]) * 1.4 == pytest.approx(
        np.cross([0.0, 0.0, 1.0], path.normal[0]), abs=1e-12
    )


def test_view_path_of_a_flat_surface():
    path = view(block(), 30.0)
    assert path.direction[0] == pytest.approx((-0.5 / 1.4, 0.0, math.sqrt(1.0 - 0.25 / 1.96)))
    expected = [(1.0 - fresnel(math.cos(math.pi / 6), 1.0 / n)[0]) / n**2 for n in (1.4, 1.42)]
    assert path.transmission[0] == pytest.approx(expected)


def test_view_beyond_an_open_patch_misses():
    path = view(block(sides="open"), at=(10.5, 5.0))
    assert not path.hit[0]
    assert np.all(path.transmission == 0.0)
    assert view(block(), at=(10.5, 5.0)).hit[0]


def test_irradiance_of_each_light():
    point = PointLight(np.array([3.0, 5.0, -4.0]), np.array([2.0, 1.0]))
    grid = np.array([[[3.0, 5.0], [6.0, 5.0]], [[13.0, 5.0], [3.0, 2.0]]])
    got = irradiance(point, grid, SIZE, True)
    assert got.shape == (2, 2, 2)
    assert got[0, 0] == pytest.approx([2.0 / 16.0, 1.0 / 16.0])
    assert got[0, 1] == pytest.approx(np.array([2.0, 1.0]) * 0.8 / 25.0)
    assert got[1, 0] == pytest.approx(got[0, 0])
    assert irradiance(sun(60.0), grid, SIZE, True) == pytest.approx(0.5)
    assert irradiance(SkyLight(np.ones(2)), grid, SIZE, True) == pytest.approx(math.pi)


def test_irradiance_of_a_slanted_beam_is_an_ellipse():
    points = np.array([[6.9, 5.0], [7.1, 5.0], [5.0, 5.9], [5.0, 6.1]])
    got = irradiance(sun(60.0, 0.0, 1.0), points, SIZE, True)[:, 0]
    assert got == pytest.approx([0.5, 0.0, 0.5, 0.0])
