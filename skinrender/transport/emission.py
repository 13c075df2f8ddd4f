"""Emission: every history starts at the lamp and is aimed at the patch, so that none is wasted.

A point lamp draws the direction uniformly over the solid angle of the patch (Urena, Fajardo and King 2013), a
collimated one the position uniformly over the patch or its own disc, a sky position and cosine-distributed direction.
All histories of a band then carry the same power: power aimed at the patch / histories.

A lamp is a tuple of LAMP_SIZE floats: kind, x, y, z of the lamp or the beam's center, direction, radius (< 0: patch), then
for a point lamp the constants of `rectangle_constants`.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import block_kernel
from skinrender.transport.blockmath import cos_sin
from skinrender.transport.lanes import LANES, UX, UY, UZ, X, Y
from skinrender.transport.rng import draw

POINT, COLLIMATED, SKY = 0, 1, 2
KIND, POSITION, DIRECTION, RADIUS, RECTANGLE = 0, 1, 4, 7, 8
LAMP_SIZE = 17


def rectangle_constants(x0: float, y0: float, x1: float, y1: float, distance: float) -> tuple[float, ...]:
    """What `spherical_rectangle` needs of a rectangle in the plane at `distance` > 0 seen from the origin, 9 floats."""

    def edge(a: float) -> tuple[float, float]:
        length = math.hypot(distance, a)
        return distance / length, a / length

    m0, m1, m2, m3 = edge(y0)[1], -edge(x1)[1], -edge(y1)[1], edge(x0)[1]
    pairs = ((m0, m1), (m1, m2), (m2, m3), (m3, m0))
    angles = [math.acos(max(-1.0, min(1.0, -a * b))) for a, b in pairs]
    solid_angle = math.fsum([*angles, -2.0 * math.pi])
    return x0, y0, x1, y1, distance, m0, m2, 2.0 * math.pi - angles[2] - angles[3], solid_angle


@block_kernel
def spherical_rectangle(x0, y0, x1, y1, distance, m0, m2, start, solid_angle, u, v):
    """Point (x, y) of a rectangle, uniform in solid angle seen from the origin; constants of `rectangle_constants`."""
    cos, sin = cos_sin(start + u * solid_angle)
    slope = (m2 - cos * m0) / sin
    x = np.copysign(distance / np.sqrt(max(slope * slope + m0 * m0 - 1.0, 1e-300)), slope)
    x = max(x0, min(x1, x))
    d2 = x * x + distance * distance
    h0 = y0 / np.sqrt(d2 + y0 * y0)
    h1 = y1 / np.sqrt(d2 + y1 * y1)
    hv = h0 + v * (h1 - h0)
    y = hv * np.sqrt(d2 / max(1.0 - hv * hv, 1e-300))
    return x, max(y0, min(y1, y))


@block_kernel
def from_point(lamp, u, v):
    """One photon of a point lamp where it is aimed at, on the mean plane of the surface: (x, y, ux, uy, uz).

    (u, v) place it in the unit square of the patch's solid angle.
    """
    c = RECTANGLE
    height = lamp[c + 4]
    dx, dy = spherical_rectangle(
        lamp[c], lamp[c + 1], lamp[c + 2], lamp[c + 3], height, lamp[c + 5], lamp[c + 6], lamp[c + 7], lamp[c + 8], u, v
    )
    inverse = 1.0 / np.sqrt(dx * dx + dy * dy + height * height)
    return lamp[POSITION] + dx, lamp[POSITION + 1] + dy, dx * inverse, dy * inverse, height * inverse


@block_kernel
def from_beam(lamp, lx, ly, u, v):
    """As `from_point`, of a collimated beam; (u, v) place it in the unit square of the patch, or on the beam's disc."""
    ux, uy, uz, radius = lamp[DIRECTION], lamp[DIRECTION + 1], lamp[DIRECTION + 2], lamp[RADIUS]
    x, y = u * lx, v * ly
    if radius >= 0.0:
        r = radius * np.sqrt(u)
        cos, sin = cos_sin(2.0 * math.pi * v)
        # the disc stands perpendicular to the beam: stretch it along the beam's lateral direction
        a, b = r * cos, r * sin
        lateral = math.sqrt(ux * ux + uy * uy)
        cx, cy = (ux / lateral, uy / lateral) if lateral > 0.0 else (1.0, 0.0)
        x = lamp[POSITION] + cx * a / uz - cy * b
        y = lamp[POSITION + 1] + cy * a / uz + cx * b
    return x, y, ux, uy, uz


@block_kernel
def from_sky(lx, ly, u, v, p, q):
    """As `from_point`, of a uniform sky; (u, v) place it in the unit square of the patch, (p, q) turn its direction."""
    sin, (cos_azimuth, sin_azimuth) = np.sqrt(p), cos_sin(2.0 * math.pi * q)
    return u * lx, v * ly, sin * cos_azimuth, sin * sin_azimuth, np.sqrt(max(1.0 - p, 1e-20))


@block_kernel
def stratum(index, count, tiles_x, tiles_y, u, v):
    """Unit-square position of history `index` of `count`: consecutive histories share a tile of about 1 mm.

    Walking neighbors together keeps the voxels they read in the cache (8 to 10 % of the walk), and the tiles are
    strata. Uniform over the square for every `count`. All float64.
    """
    along = (index + u) / count * (tiles_x * tiles_y)
    tile = min(np.floor(along), tiles_x * tiles_y - 1.0)
    row = np.floor((tile + 0.5) / tiles_x)
    return (tile - row * tiles_x + (along - tile)) / tiles_x, (row + v) / tiles_y


@block_kernel
def emit(f, w, n, first, count, tiles_x, tiles_y, lamp, lx, ly):
    """Puts n lanes, whose generators have been seeded, where their histories are aimed at, on the mean plane.

    They are the histories `first` and on of the `count` of a round.
    """
    kind = int(lamp[KIND])
    for i in range(n):
        u, v = stratum(np.float64(first + i), count, tiles_x, tiles_y, draw(w, i, LANES), draw(w, i, LANES))
        if kind == POINT:
            x, y, ux, uy, uz = from_point(lamp, u, v)
        elif kind == COLLIMATED:
            x, y, ux, uy, uz = from_beam(lamp, lx, ly, u, v)
        else:
            x, y, ux, uy, uz = from_sky(lx, ly, u, v, draw(w, i, LANES), draw(w, i, LANES))
        f[X + i], f[Y + i], f[UX + i], f[UY + i], f[UZ + i] = x, y, ux, uy, uz


def point_parameters(position, size, z_mean: float) -> tuple[float, ...]:
    """A point lamp aimed at the rectangle of a patch; lengths in mm from the top of the volume."""
    x, y, z = position
    aim = rectangle_constants(-x, -y, size[0] - x, size[1] - y, z_mean - z)
    return _lamp(POINT, x, y, z, 0.0, 0.0, 1.0, -1.0, *aim)


def collimated_parameters(position, direction, radius: float | None) -> tuple[float, ...]:
    """A collimated beam through (x, y) of the mean plane; radius None lights the whole patch."""
    return _lamp(COLLIMATED, position[0], position[1], 0.0, *direction, -1.0 if radius is None else radius)


def sky_parameters() -> tuple[float, ...]:
    """A uniform sky."""
    return _lamp(SKY)


def _lamp(*values: float) -> tuple[float, ...]:
    return tuple(float(value) for value in values) + (0.0,) * (LAMP_SIZE - len(values))
