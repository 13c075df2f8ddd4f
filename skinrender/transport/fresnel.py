"""A smooth border between two dielectrics: unpolarized Fresnel reflectance, Snell's law, reflected direction.

`eta` is n_incident / n_transmitted throughout; `cos_i` is the cosine between the flight and the normal, >= 0.
"""

from __future__ import annotations

import math

from skinrender.transport import kernel


@kernel
def fresnel(cos_i, eta):
    """Reflectance for unpolarized light and the cosine of the refracted flight; (1, 0) under total reflection."""
    if eta == 1.0:
        return 0.0, cos_i
    sin2_t = eta * eta * (1.0 - cos_i) * (1.0 + cos_i)
    if sin2_t >= 1.0:
        return 1.0, 0.0
    cos_t = math.sqrt(1.0 - sin2_t)
    perpendicular = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    parallel = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    return 0.5 * (perpendicular * perpendicular + parallel * parallel), cos_t


@kernel
def refract(ux, uy, uz, nx, ny, nz, eta, cos_i, cos_t):
    """Refracted unit direction.

    n is the unit normal on the side the flight goes to (u . n = cos_i >= 0); cos_t comes from `fresnel`.
    """
    shift = cos_t - eta * cos_i
    return eta * ux + shift * nx, eta * uy + shift * ny, eta * uz + shift * nz


@kernel
def reflect(ux, uy, uz, nx, ny, nz):
    """Mirrored unit direction; the sign of the unit normal n does not matter."""
    twice = 2.0 * (ux * nx + uy * ny + uz * nz)
    return ux - twice * nx, uy - twice * ny, uz - twice * nz
