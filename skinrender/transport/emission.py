"""Emission: every history starts at the lamp and is aimed at the patch, so that none is wasted.

A point lamp draws the direction uniformly over the solid angle of the patch (Urena, Fajardo and King 2013), a
collimated one the position uniformly over the patch or its own disc, a sky position and cosine-distributed direction.
All histories of a band then carry the same power: power aimed at the patch / histories.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import inlined_kernel

POINT, COLLIMATED, SKY = 0, 1, 2
# Layout of a light's parameters (float64): kind, x, y, z of the lamp or the beam's center, direction, radius (< 0:
# patch), then for a point lamp the constants of `rectangle_constants`.
KIND, LAMP, DIRECTION, RADIUS, RECTANGLE = 0, 1, 4, 7, 8


def rectangle_constants(x0: float, y0: float, x1: float, y1: float, distance: float) -> np.ndarray:
    """What `spherical_rectangle` needs of a rectangle in the plane at `distance` > 0 seen from the origin, (9,)."""

    def edge(a: float) -> tuple[float, float]:
        length = math.hypot(distance, a)
        return distance / length, a / length

    m0, m1, m2, m3 = edge(y0)[1], -edge(x1)[1], -edge(y1)[1], edge(x0)[1]
    pairs = ((m0, m1), (m1, m2), (m2, m3), (m3, m0))
    angles = [math.acos(max(-1.0, min(1.0, -a * b))) for a, b in pairs]
    solid_angle = math.fsum([*angles, -2.0 * math.pi])
    return np.array([x0, y0, x1, y1, distance, m0, m2, 2.0 * math.pi - angles[2] - angles[3], solid_angle])


@inlined_kernel
def spherical_rectangle(c, u, v):
    """Point (x, y) of a rectangle, uniform in solid angle seen from the origin; c of `rectangle_constants`."""
    x0, y0, x1, y1, distance, m0, m2, start, solid_angle = c
    turn = start + u * solid_angle
    slope = (m2 - math.cos(turn) * m0) / math.sin(turn)
    x = math.copysign(distance / math.sqrt(max(slope * slope + m0 * m0 - 1.0, 1e-300)), slope)
    x = max(x0, min(x1, x))
    d2 = x * x + distance * distance
    h0 = y0 / math.sqrt(d2 + y0 * y0)
    h1 = y1 / math.sqrt(d2 + y1 * y1)
    hv = h0 + v * (h1 - h0)
    y = hv * math.sqrt(d2 / max(1.0 - hv * hv, 1e-300))
    return x, max(y0, min(y1, y))


@inlined_kernel
def emit(light, lx, ly, z_mean, u, v, p, q):
    """One photon of the lamp where it passes the top plane z = 0 of the volume: (x, y, ux, uy, uz).

    (u, v) place it in the unit square of the patch (or of its solid angle), (p, q) turn a sky's direction.
    `z_mean` is the depth of the mean plane of the surface, at which the lamp is aimed.
    """
    kind = int(light[KIND])
    if kind == POINT:
        c = RECTANGLE
        rectangle = (
            light[c], light[c + 1], light[c + 2], light[c + 3], light[c + 4], light[c + 5], light[c + 6], light[c + 7],
            light[c + 8],
        )  # fmt: skip
        dx, dy = spherical_rectangle(rectangle, u, v)
        height, above = light[c + 4], 1.0 - z_mean / light[c + 4]
        inverse = 1.0 / math.sqrt(dx * dx + dy * dy + height * height)
        return light[LAMP] + dx * above, light[LAMP + 1] + dy * above, dx * inverse, dy * inverse, height * inverse
    if kind == COLLIMATED:
        ux, uy, uz = light[DIRECTION], light[DIRECTION + 1], light[DIRECTION + 2]
        radius = light[RADIUS]
        if radius < 0.0:
            x, y = u * lx, v * ly
        else:
            r, angle = radius * math.sqrt(u), 2.0 * math.pi * v
            # the disc stands perpendicular to the beam: stretch it along the beam's lateral direction
            a, b = r * math.cos(angle), r * math.sin(angle)
            lateral = math.sqrt(ux * ux + uy * uy)
            cx, cy = (ux / lateral, uy / lateral) if lateral > 0.0 else (1.0, 0.0)
            x = light[LAMP] + cx * a / uz - cy * b
            y = light[LAMP + 1] + cy * a / uz + cx * b
    else:
        x, y = u * lx, v * ly
        sin, angle = math.sqrt(p), 2.0 * math.pi * q
        ux, uy, uz = sin * math.cos(angle), sin * math.sin(angle), math.sqrt(max(1.0 - p, 1e-20))
    back = z_mean / uz
    return x - ux * back, y - uy * back, ux, uy, uz


@inlined_kernel
def tile_position(index, count, tiles_x, tiles_y, u, v):
    """Unit-square position of history `index` of `count`: consecutive histories share a tile of about 1 mm.

    Walking neighbors together keeps the voxels they read in the cache (8 to 10 % of the walk), and the tiles are
    strata. Uniform over the square for every `count`.
    """
    along = (index + u) / count * (tiles_x * tiles_y)
    tile = min(math.floor(along), tiles_x * tiles_y - 1.0)
    row = math.floor((tile + 0.5) / tiles_x)
    return (tile - row * tiles_x + (along - tile)) / tiles_x, (row + v) / tiles_y


def point_parameters(position, size, z_mean: float) -> np.ndarray:
    """Parameters of a point lamp aimed at the rectangle of a patch; lengths in mm from the top of the volume."""
    x, y, z = position
    aim = rectangle_constants(-x, -y, size[0] - x, size[1] - y, z_mean - z)
    return np.concatenate([[POINT, x, y, z, 0.0, 0.0, 1.0, -1.0], aim]).astype(np.float64)


def collimated_parameters(position, direction, radius: float | None) -> np.ndarray:
    """Parameters of a collimated beam through (x, y) of the mean plane; radius None lights the whole patch."""
    return np.array([COLLIMATED, position[0], position[1], 0.0, *direction, -1.0 if radius is None else radius])


def sky_parameters() -> np.ndarray:
    """Parameters of a uniform sky."""
    return np.array([SKY, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0])
