"""What is known exactly of light in simple slabs: the measure of the stiff and extreme cases.

Isotropic scattering in a half space: S. Chandrasekhar, Radiative Transfer (1950), chapters V and VI. Thick conservative
slabs: H. C. van de Hulst, Multiple Light Scattering (1980), chapter 5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

MILNE = 0.7104460896
"""Extrapolation length of the conservative half space, in mean free paths (Hopf's constant)."""


def h_function(albedo: float, mu: float) -> float:
    """Chandrasekhar's H of isotropic scattering at a cosine, from its closed integral (p. 116)."""

    def integrand(theta: float) -> float:
        cotangent = theta / math.tan(theta) if theta > 0.0 else 1.0
        return math.log1p(-albedo * cotangent) / (math.cos(theta) ** 2 + (mu * math.sin(theta)) ** 2)

    return math.exp(-mu / math.pi * quad(integrand, 1e-12, 0.5 * math.pi, limit=400, epsabs=1e-11)[0])


def half_space_reflectance(albedo: float, mu: float = 1.0) -> float:
    """Share of a beam at a cosine that an isotropic half space of matched index reflects."""
    return 1.0 - math.sqrt(1.0 - albedo) * h_function(albedo, mu)


def half_space_diffuse_reflectance(albedo: float) -> float:
    """Share of Lambertian light that an isotropic half space of matched index reflects."""
    return quad(lambda mu: 2.0 * mu * half_space_reflectance(albedo, mu), 0.0, 1.0, epsabs=1e-7)[0]


def half_space_radiance(albedo: float, mu: float, mu_light: float = 1.0) -> float:
    """Radiance that leaves an isotropic half space at a cosine, per irradiance across the beam, 1/sr."""
    spread = mu_light / (mu + mu_light) * h_function(albedo, mu) * h_function(albedo, mu_light)
    return albedo / (4.0 * math.pi) * spread


def conservative_transmittance(optical_depth: float) -> float:
    """Share of a perpendicular beam that a thick slab of isotropic scattering and albedo 1 transmits.

    The error falls as exp(-2 optical depth).
    """
    escape = 0.25 * math.sqrt(3.0) * h_function(1.0, 1.0)
    return 4.0 / 3.0 * escape / (optical_depth + 2.0 * MILNE)


def border_reflectance(cosine: float, n_from: float, n_to: float) -> tuple[float, float]:
    """Fresnel reflectance of unpolarized light, and the cosine beyond (0 under total reflection)."""
    sine2 = (n_from / n_to) ** 2 * (1.0 - cosine**2)
    if sine2 >= 1.0:
        return 1.0, 0.0
    beyond = math.sqrt(1.0 - sine2)
    s = (n_from * cosine - n_to * beyond) / (n_from * cosine + n_to * beyond)
    p = (n_to * cosine - n_from * beyond) / (n_to * cosine + n_from * beyond)
    return 0.5 * (s * s + p * p), beyond


def clear_stack(
    optical_depths: Sequence[float], indices: Sequence[float], cosine: float = 1.0
) -> tuple[float, float, np.ndarray]:
    """R, T and absorption by layer of a beam on layers that absorb and don't scatter.

    The fluxes down at the top and up at the bottom of each layer are the solution of a linear system.

    Parameters
    ----------
    optical_depths : (L,) across each layer.
    indices : (L + 2,) of refraction, from above to below.
    cosine : of the beam outside.
    """
    count, reflected, passed = len(optical_depths), [], []
    for (above, below), tau in zip(pairwise(indices), [*optical_depths, 0.0]):
        r, cosine = border_reflectance(cosine, above, below)
        if r == 1.0:
            return 1.0, 0.0, np.zeros(count)
        reflected.append(r)
        passed.append(math.exp(-tau / cosine))
    r, t = np.array(reflected), np.array(passed[:-1])
    matrix, source = np.eye(2 * count), np.zeros(2 * count)
    source[0] = 1.0 - r[0]
    for k in range(count):
        matrix[k, count + k] -= r[k] * t[k]
        matrix[count + k, k] -= r[k + 1] * t[k]
        if k > 0:
            matrix[k, k - 1] -= (1.0 - r[k]) * t[k - 1]
        if k < count - 1:
            matrix[count + k, count + k + 1] -= (1.0 - r[k + 1]) * t[k + 1]
    down, up = np.split(np.linalg.solve(matrix, source), 2)
    absorbed = (down + up) * (1.0 - t)
    return float(r[0] + (1.0 - r[0]) * up[0] * t[0]), float((1.0 - r[-1]) * down[-1] * t[-1]), absorbed
