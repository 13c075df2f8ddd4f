"""Emission: every history starts at the lamp and is aimed at the patch, so that none is wasted.

A point lamp draws the direction uniformly over the solid angle of the patch (Urena, Fajardo and King 2013), a collimated
one the position uniformly over the patch or its own disc, a sky position and cosine-distributed direction. All
histories of a band then carry the same power: power aimed at the patch / histories.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import kernel

POINT, COLLIMATED, SKY = 0, 1, 2
# Layout of a light's parameters (float64): kind, x, y, z of the lamp or the beam's center, direction, radius (< 0: patch)
LIGHT_SIZE = 8


@kernel
def spherical_rectangle(x0, y0, x1, y1, distance, u, v):
    """Point (x, y) of a rectangle in the plane at `distance` > 0, uniform in solid angle seen from the origin."""
    z = -distance
    xx0, yy0, xx1, yy1 = x0, y0, x1, y1
    n0 = -z / math.sqrt(z * z + yy0 * yy0)
    n1 = -z / math.sqrt(z * z + xx1 * xx1)
    n2 = -z / math.sqrt(z * z + yy1 * yy1)
    n3 = -z / math.sqrt(z * z + xx0 * xx0)
    m0 = yy0 / math.sqrt(z * z + yy0 * yy0)
    m1 = -xx1 / math.sqrt(z * z + xx1 * xx1)
    m2 = -yy1 / math.sqrt(z * z + yy1 * yy1)
    m3 = xx0 / math.sqrt(z * z + xx0 * xx0)
    g0 = math.acos(max(-1.0, min(1.0, -m0 * m1)))
    g1 = math.acos(max(-1.0, min(1.0, -m1 * m2)))
    g2 = math.acos(max(-1.0, min(1.0, -m2 * m3)))
    g3 = math.acos(max(-1.0, min(1.0, -m3 * m0)))
    solid_angle = g0 + g1 + g2 + g3 - 2.0 * math.pi
    au = u * solid_angle + 2.0 * math.pi - g2 - g3
    fu = (math.cos(au) * m0 - m2) / math.sin(au)
    cu = math.copysign(1.0, fu) / math.sqrt(fu * fu + m0 * m0)
    cu = max(-1.0, min(1.0, cu))
    xu = -(cu * z) / math.sqrt(max(1.0 - cu * cu, 1e-300))
    xu = max(xx0, min(xx1, xu))
    d = math.sqrt(xu * xu + z * z)
    h0 = yy0 / math.sqrt(d * d + yy0 * yy0)
    h1 = yy1 / math.sqrt(d * d + yy1 * yy1)
    hv = h0 + v * (h1 - h0)
    yv = hv * d / math.sqrt(max(1.0 - hv * hv, 1e-300))
    return xu, max(yy0, min(yy1, yv))


@kernel
def emit(light, lx, ly, z_mean, u, v, p, q):
    """One photon of the lamp where it passes the top plane z = 0 of the volume: (x, y, ux, uy, uz).

    (u, v) place it in the unit square of the patch (or of its solid angle), (p, q) turn a sky's direction.
    `z_mean` is the depth of the mean plane of the surface, at which the lamp is aimed.
    """
    kind = int(light[0])
    if kind == POINT:
        lamp_x, lamp_y, distance = light[1], light[2], z_mean - light[3]
        dx, dy = spherical_rectangle(-lamp_x, -lamp_y, lx - lamp_x, ly - lamp_y, distance, u, v)
        length = math.sqrt(dx * dx + dy * dy + distance * distance)
        ux, uy, uz = dx / length, dy / length, distance / length
        x, y = lamp_x + dx, lamp_y + dy
    elif kind == COLLIMATED:
        ux, uy, uz = light[4], light[5], light[6]
        radius = light[7]
        if radius < 0.0:
            x, y = u * lx, v * ly
        else:
            r, angle = radius * math.sqrt(u), 2.0 * math.pi * v
            # the disc stands perpendicular to the beam: stretch it along the beam's lateral direction
            a, b = r * math.cos(angle), r * math.sin(angle)
            lateral = math.sqrt(ux * ux + uy * uy)
            cx, cy = (ux / lateral, uy / lateral) if lateral > 0.0 else (1.0, 0.0)
            x = light[1] + cx * a / uz - cy * b
            y = light[2] + cy * a / uz + cx * b
    else:
        x, y = u * lx, v * ly
        sin, angle = math.sqrt(p), 2.0 * math.pi * q
        ux, uy, uz = sin * math.cos(angle), sin * math.sin(angle), math.sqrt(max(1.0 - p, 1e-20))
    back = z_mean / uz
    return x - ux * back, y - uy * back, ux, uy, uz


@kernel
def tile_position(index, count, tiles_x, tiles_y, u, v):
    """Unit-square position of history `index` of `count`: consecutive histories share a tile of about 1 mm.

    Walking neighbors together keeps the voxels they read in the cache (8 to 10 % of the walk), and the tiles are
    strata. Uniform over the square for every `count`.
    """
    along = (index + u) / count * (tiles_x * tiles_y)
    tile = min(int(along), tiles_x * tiles_y - 1)
    tx, ty = tile % tiles_x, tile // tiles_x
    return (tx + (along - tile)) / tiles_x, (ty + v) / tiles_y


def light_parameters(kind: int, position=(0.0, 0.0, 0.0), direction=(0.0, 0.0, 1.0), radius: float = -1.0) -> np.ndarray:
    """Flat float64 parameters of a light: kind POINT, COLLIMATED or SKY; lengths in mm from the top of the volume."""
    return np.array([kind, *position, *direction, radius], dtype=np.float64)
