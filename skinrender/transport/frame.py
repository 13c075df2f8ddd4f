"""An orthonormal frame about a direction, and turning a direction by given angles."""

from __future__ import annotations

import math

from skinrender.transport import kernel


@kernel
def frame(nx, ny, nz):
    """Two unit vectors t, b that make (t, b, n) right-handed and orthonormal; no branch, no singular direction.

    Source: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def turn(ux, uy, uz, one_minus_cos, phi):
    """Unit direction at the polar angle given by 1 - cos(theta) and the azimuth phi about the unit direction u."""
    sin_theta = math.sqrt(max(0.0, one_minus_cos * (2.0 - one_minus_cos)))
    cos_theta = 1.0 - one_minus_cos
    tx, ty, tz, bx, by, bz = frame(ux, uy, uz)
    c, s = sin_theta * math.cos(phi), sin_theta * math.sin(phi)
    return c * tx + s * bx + cos_theta * ux, c * ty + s * by + cos_theta * uy, c * tz + s * bz + cos_theta * uz
