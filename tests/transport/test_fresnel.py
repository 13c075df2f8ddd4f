"""Fresnel and Snell: closed forms, reciprocity, the limits."""

import math

import numpy as np
import pytest

from skinrender.transport.fresnel import fresnel, reflect, refract


@pytest.mark.parametrize("eta", [1.4, 1 / 1.4, 1.55 / 1.33, 0.999])
def test_normal_incidence(eta):
    reflectance, cos_t = fresnel(1.0, eta)
    assert reflectance == pytest.approx(((eta - 1.0) / (eta + 1.0)) ** 2, abs=1e-15)
    assert cos_t == 1.0


def test_equal_indices_are_exact():
    for cos_i in (0.0, 1e-9, 0.3, 1.0):
        assert fresnel(cos_i, 1.0) == (0.0, cos_i)


def test_reflectance_is_the_same_from_both_sides():
    for cos_i in np.linspace(0.01, 1.0, 25):
        forth, cos_t = fresnel(cos_i, 1 / 1.45)
        back, cos_b = fresnel(cos_t, 1.45)
        assert forth == pytest.approx(back, rel=1e-10)
        assert cos_b == pytest.approx(cos_i, rel=1e-10)


def test_brewster_angle_leaves_one_polarization():
    n = 1.5
    cos_i = math.cos(math.atan(n))
    reflectance, _ = fresnel(cos_i, 1 / n)
    assert reflectance == pytest.approx(0.5 * ((n * n - 1) / (n * n + 1)) ** 2)


def test_total_reflection():
    critical = math.sqrt(1.0 - 1.0 / 1.4**2)
    assert fresnel(critical * 0.999, 1.4) == (1.0, 0.0)
    assert fresnel(critical * 1.001, 1.4)[0] < 1.0


def test_grazing_incidence_tends_to_one():
    assert fresnel(0.0, 1 / 1.4)[0] == 1.0
    assert 0.999 < fresnel(1e-5, 1 / 1.4)[0] < 1.0


def test_diffuse_mean_reflectance():
    """Hemispherical mean for n = 1.5: 0.0918 (Orchard, J. Opt. Soc. Am. 59, 1584, 1969)."""
    x, w = np.polynomial.legendre.leggauss(200)
    mu = 0.5 * (x + 1.0)
    mean = np.sum(w * mu * [fresnel(m, 1 / 1.5)[0] for m in mu])
    assert mean == pytest.approx(0.0918, abs=5e-5)


def test_refracted_direction_obeys_snell_and_reverses():
    rng = np.random.default_rng(3)
    for _ in range(50):
        n, u = rng.normal(size=(2, 3))
        n /= np.linalg.norm(n)
        u /= np.linalg.norm(u)
        n *= np.sign(u @ n)
        cos_i = u @ n
        _, cos_t = fresnel(cos_i, 1 / 1.4)
        v = np.array(refract(*u, *n, 1 / 1.4, cos_i, cos_t))
        assert v @ v == pytest.approx(1.0)
        assert v @ n == pytest.approx(cos_t)
        assert 1.4 * np.cross(v, n) == pytest.approx(np.cross(u, n), abs=1e-12)
        assert refract(*-v, *-n, 1.4, cos_t, cos_i) == pytest.approx(tuple(-u), abs=1e-12)


def test_reflected_direction():
    assert reflect(0.6, 0.0, 0.8, 0.0, 0.0, 1.0) == pytest.approx((0.6, 0.0, -0.8))
    assert reflect(0.6, 0.0, 0.8, 0.0, 0.0, -1.0) == pytest.approx((0.6, 0.0, -0.8))
