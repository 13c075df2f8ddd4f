"""Single scattering against closed forms and independent quadrature."""

import math

import numpy as np
import pytest
from scipy import integrate

from skinrender.estimate.connection import refracted_pencil
from skinrender.estimate.single import has_single_term, single_scattering
from skinrender.estimate.view_path import make_view_path
from skinrender.photonmap.light import CollimatedLight, PointLight, SkyLight, flight_direction
from skinrender.skin.volume import SkinVolume
from skinrender.transport.fresnel import fresnel
from skinrender.transport.phase import phase_hg

SIZE = (10.0, 10.0)


def slab(layers, n=1.0, sides="periodic", palette=None, columns=(1, 1)):
    """Volume of layers (thickness, mu_a, mu_s, g), one band, one palette entry each (0 = air)."""
    thickness, mu_a, mu_s, g = np.array(layers, float).T
    count = len(layers)
    if palette is None:
        palette = np.broadcast_to(np.arange(1, count + 1, dtype=np.uint16), (*columns, count))
    edges = np.concatenate([[0.0], np.cumsum(thickness)])[: palette.shape[2] + 1]

    def coefficients(values):
        return np.concatenate([[0.0], values])[:, None]

    return SkinVolume(
        palette_index=np.ascontiguousarray(palette, np.uint16), z_edges_mm=edges,
        palette_layer=np.arange(count + 1, dtype=np.uint8), palette_melanin=np.zeros(count + 1, np.float32),
        mu_a=coefficients(mu_a), mu_s=coefficients(mu_s), g=coefficients(g),
        refractive_index=np.array([[1.0]] + [[n]] * count), wavelength_nm=np.array([550.0]),
        layer_name=("air", *(f"layer_{k + 1}" for k in range(count))), size_mm=SIZE,
        border_z_mm=np.concatenate([[0.0], np.cumsum(thickness)]), n_outside=np.ones(1), n_below=np.full(1, n),
        sides=sides,
    )  # fmt: skip


def looking(direction, at=(5.0, 5.0)):
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    return np.array([[*at, 0.0]]) - 30.0 * direction, direction[None]


def beam(zenith=0.0, azimuth=0.0, radius=None):
    return CollimatedLight(flight_direction(zenith, azimuth), np.ones(1), radius, np.array([5.0, 5.0]))


def radiance(volume, light, direction=(0.0, 0.0, 1.0), at=(5.0, 5.0)):
    return single_scattering(make_view_path(*looking(direction, at), volume), volume, light)[0, 0]


def closed_form(mu_a, mu_s, g, thickness, cos_l, cos_v, cos_turn, irradiance):
    """Parallel light of given irradiance across the beam in a uniform slab of equal index."""
    slant = (mu_a + mu_s) * (1.0 / cos_l + 1.0 / cos_v)
    return irradiance * mu_s * phase_hg(cos_turn, g) * -math.expm1(-slant * thickness) / (slant * cos_v)


@pytest.mark.parametrize("thickness", [1e-4, 0.1, 3.0])
def test_matched_slab_under_normal_light_and_view(thickness):
    got = radiance(slab([(thickness, 0.6, 40.0, 0.8)]), beam())
    assert got == pytest.approx(closed_form(0.6, 40.0, 0.8, thickness, 1.0, 1.0, -1.0, 1.0), rel=1e-9)


@pytest.mark.parametrize("azimuth", [0.0, 60.0, 180.0])
def test_matched_slab_under_oblique_light_and_view(azimuth):
    cos_l, view = 0.5, np.array([math.sin(0.7), 0.0, math.cos(0.7)])
    got = radiance(slab([(0.2, 0.3, 7.0, 0.6)]), beam(60.0, azimuth), view)
    turn = -flight_direction(60.0, azimuth) @ view
    assert got == pytest.approx(closed_form(0.3, 7.0, 0.6, 0.2, cos_l, math.cos(0.7), turn, 1.0), rel=1e-9)


def test_refracting_slab_under_oblique_light_and_view():
    n, view = 1.4, np.array([0.0, math.sin(0.5), math.cos(0.5)])
    light = flight_direction(40.0, 20.0)
    inner_l = np.array([*light[:2] / n, 0.0])
    inner_v = np.array([*view[:2] / n, 0.0])
    inner_l[2], inner_v[2] = math.sqrt(1 - inner_l @ inner_l), math.sqrt(1 - inner_v @ inner_v)
    strength = (1 - fresnel(light[2], 1 / n)[0]) * light[2] / inner_l[2]
    outside = (1 - fresnel(view[2], 1 / n)[0]) / n**2
    expected = outside * closed_form(0.3, 7.0, 0.6, 0.5, inner_l[2], inner_v[2], -inner_l @ inner_v, strength)
    assert radiance(slab([(0.5, 0.3, 7.0, 0.6)], n), beam(40.0, 20.0), view) == pytest.approx(expected, rel=1e-9)


def test_layers_of_equal_optics_are_one_layer():
    whole = radiance(slab([(1.0, 0.3, 7.0, 0.6)], 1.4), beam(30.0))
    parts = radiance(slab([(0.01, 0.3, 7.0, 0.6), (0.3, 0.3, 7.0, 0.6), (0.69, 0.3, 7.0, 0.6)], 1.4), beam(30.0))
    assert parts == pytest.approx(whole, rel=1e-12)


def test_point_light_in_a_matched_medium_against_quadrature():
    lamp, at, mu_a, mu_s, g = np.array([2.0, 7.0, -18.0]), np.array([6.0, 3.0, 0.0]), 0.6, 40.0, 0.8
    view = np.array([0.3, -0.2, 1.0]) / math.sqrt(1.13)

    def integrand(s):
        x = at + s * view
        d = x - lamp
        distance = math.sqrt(d @ d)
        inside = distance * x[2] / d[2]
        return mu_s * phase_hg(-(d @ view) / distance, g) * math.exp(-(mu_a + mu_s) * (s + inside)) / distance**2

    expected = integrate.quad(integrand, 0.0, 1.0, epsabs=0.0, epsrel=1e-10, limit=200)[0]
    got = radiance(slab([(3.0, mu_a, mu_s, g)]), PointLight(lamp, np.ones(1)), view, at[:2])
    assert got == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("eta", [1.0 / 1.4, 1.0, 1.3])
def test_pencil_spreads_as_its_edge_rays_do(eta):
    """d(omega)/dA from two close cones of rays, followed by Snell's law alone."""
    height, depth = 5.0, 2.0

    def lateral(angle):
        return height * math.tan(angle) + depth * math.tan(math.asin(eta * math.sin(angle)))

    for angle in (0.05, 0.4, 0.7):
        cos_o, cos_i, spread = refracted_pencil(lateral(angle), height, depth, eta)
        assert cos_o == pytest.approx(math.cos(angle), rel=1e-10)
        step = 1e-5
        solid_angle = math.cos(angle - step) - math.cos(angle + step)
        ring = 0.5 * (lateral(angle + step) ** 2 - lateral(angle - step) ** 2) * cos_i
        assert spread == pytest.approx(solid_angle / ring, rel=1e-6)


def test_pencil_straight_below_the_lamp():
    n, height, depth = 1.5, 10.0, 3.0
    assert refracted_pencil(0.0, height, depth, 1 / n) == pytest.approx((1.0, 1.0, 1.0 / (height + depth / n) ** 2))


def test_far_point_light_is_parallel_light():
    volume = slab([(0.5, 0.3, 7.0, 0.6)], 1.4)
    far = 1e6
    light = PointLight(np.array([5.0, 5.0, -far]), np.full(1, far**2))
    assert radiance(volume, light) == pytest.approx(radiance(volume, beam()), rel=1e-5)


def test_varying_columns_against_dense_quadrature():
    """Oblique light and view through two kinds of columns; sums over small steps as the independent answer."""
    palette = np.ones((20, 1, 2), np.uint16)
    palette[5:15, :, 0] = 2
    volume = slab([(0.5, 0.2, 1.5, 0.3), (1.0, 2.0, 3.0, 0.7)], palette=palette)
    light, view = flight_direction(35.0, 0.0), np.array([0.6, 0.0, 0.8])

    def entry(p):
        top = np.where((np.floor(p[:, 0] / 2.5) % 4 == 1) | (np.floor(p[:, 0] / 2.5) % 4 == 2), 2, 1)
        return np.where(p[:, 2] < 0.5, top, 1)

    mu_t = (volume.mu_a + volume.mu_s)[:, 0]
    s = (np.arange(1500) + 0.5) * (1.5 / 0.8 / 1500)
    points = np.array([7.2, 5.0, 0.0]) + s[:, None] * view
    view_step = mu_t[entry(points)] * s[0] * 2
    tau = np.cumsum(view_step) - 0.5 * view_step
    total = 0.0
    for point, depth in zip(points, tau, strict=True):
        t = (np.arange(400) + 0.5) / 400 * (point[2] / light[2])
        back = mu_t[entry(point - t[:, None] * light)].mean() * point[2] / light[2]
        kind = entry(point[None])[0]
        total += math.exp(-depth - back) * volume.mu_s[kind, 0] * phase_hg(-light @ view, volume.g[kind, 0]) * s[0] * 2
    got = radiance(volume, beam(35.0), view, (7.2, 5.0))
    assert got == pytest.approx(total, rel=5e-3)


def test_each_tile_is_lit_by_its_own_lamp():
    """Just beyond the seam the pixel sees what its neighbor across the tile sees, mirrored."""
    volume = slab([(3.0, 0.6, 10.0, 0.8)], 1.4)
    light = PointLight(np.array([5.0, 5.0, -10.0]), np.ones(1))
    assert radiance(volume, light, at=(9.7, 5.0)) == pytest.approx(radiance(volume, light, at=(10.3, 5.0)), rel=1e-9)
    # light of the neighboring lamp adds under the seam, nothing is missing there
    alone = radiance(slab([(3.0, 0.6, 10.0, 0.8)], 1.4, "open"), light, at=(9.999, 5.0))
    assert 1.5 < radiance(volume, light, at=(9.999, 5.0)) / alone < 2.1


def test_a_beam_lights_its_disc_only():
    volume = slab([(1.0, 0.3, 30.0, 0.6)])
    assert radiance(volume, beam(radius=1.0), at=(5.9, 5.0)) == pytest.approx(radiance(volume, beam()), rel=1e-9)
    assert radiance(volume, beam(radius=1.0), at=(6.1, 5.0)) == 0.0
    assert radiance(volume, beam(60.0, radius=1.0), at=(6.9, 5.0)) > 0.0
    assert radiance(volume, beam(60.0, radius=1.0), at=(5.0, 6.1)) == 0.0


@pytest.mark.parametrize("n", [1.0, 1.4])
def test_sky_is_the_sum_of_its_directions(n):
    volume = slab([(0.1, 0.3, 7.0, 0.6), (0.5, 1.0, 20.0, 0.8)], n)
    view = np.array([0.5, 0.0, math.sqrt(0.75)])
    x, w = np.polynomial.legendre.leggauss(24)
    total = 0.0
    for cos_o, weight in zip(0.5 * (x + 1.0), 0.5 * w, strict=True):
        for azimuth in np.arange(24) * 15.0 + 7.5:
            light = beam(math.degrees(math.acos(cos_o)), azimuth)
            total += weight * math.radians(15.0) * radiance(volume, light, view)
    assert radiance(volume, SkyLight(np.ones(1)), view) == pytest.approx(total, rel=1e-3)


def test_sky_over_a_range_of_views_is_the_same_as_one_by_one():
    volume = slab([(0.1, 0.3, 7.0, 0.6), (0.5, 1.0, 20.0, 0.8)], 1.4)
    angles = np.linspace(0.0, 1.3, 20)
    rays = [looking((math.sin(a), 0.0, math.cos(a))) for a in angles]
    view = make_view_path(np.concatenate([r[0] for r in rays]), np.concatenate([r[1] for r in rays]), volume)
    together = single_scattering(view, volume, SkyLight(np.ones(1)))[:, 0]
    alone = [radiance(volume, SkyLight(np.ones(1)), r[1][0]) for r in rays]
    assert together == pytest.approx(np.array(alone), rel=1e-6)


def test_where_passages_are_not_unique_first_scatterings_are_photons():
    volume = slab([(1.0, 0.3, 7.0, 0.6)])
    assert has_single_term(volume, beam())
    assert not has_single_term(volume, beam(radius=0.0))
    assert not has_single_term(slab([(1.0, 0.3, 7.0, 0.6)], sides="open"), SkyLight(np.ones(1)))
    assert radiance(volume, beam(radius=0.0)) == 0.0


@pytest.mark.parametrize("layer", [(1.0, 0.0, 0.0, 0.0), (1.0, 700.0, 0.0, 0.5), (1e-3, 0.0, 500.0, -0.999)])
def test_extreme_coefficients_stay_finite(layer):
    for light in (beam(89.0), PointLight(np.array([5.0, 5.0, -1.0]), np.full(1, 1e30)), SkyLight(np.ones(1))):
        value = radiance(slab([layer], 1.5), light, (0.99, 0.0, 0.1))
        assert np.isfinite(value)
        assert value >= 0.0
