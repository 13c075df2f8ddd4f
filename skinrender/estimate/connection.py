"""The straight refracted passage from a lamp through a flat surface to a point inside.

What arrives is a pencil whose spreading follows from Snell's law: intensity (1 - F) d(omega)/dA, with d(omega) the
pencil's solid angle at the lamp and dA its cross section at the point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.photonmap.light import CollimatedLight, PointLight
from skinrender.transport import kernel

_ITERATIONS = 60


class Lamp(NamedTuple):
    """A point or collimated lamp as the kernels read it; lengths in mm.

    x, y: foot of a point lamp or of a beam's axis; height: of a point lamp; dx, dy, dz: refracted direction of a
    beam, cos_outside: its cosine outside; radius: of the beam (inf: no limit).
    """

    is_point: bool
    x: float
    y: float
    height: float
    dx: float
    dy: float
    dz: float
    cos_outside: float
    radius: float


def make_lamp(light: PointLight | CollimatedLight, eta: float) -> Lamp:
    """Executed form of a lamp over tissue with eta = n_outside / n_tissue."""
    if isinstance(light, PointLight):
        x, y, z = map(float, light.position_mm)
        return Lamp(True, x, y, -z, 0.0, 0.0, 1.0, 1.0, math.inf)
    ux, uy, uz = map(float, light.direction)
    dz = math.sqrt(max(0.0, 1.0 - eta * eta * (ux * ux + uy * uy)))
    radius = math.inf if light.radius_mm is None else float(light.radius_mm)
    return Lamp(False, *map(float, light.position_mm), 0.0, eta * ux, eta * uy, dz, uz, radius)


@kernel
def refracted_pencil(lateral, height, depth, eta):
    """Pencil from a point lamp to a point inside a flat medium.

    Parameters
    ----------
    lateral : horizontal distance between lamp and point, mm.
    height, depth : of the lamp above and of the point below the surface, mm.
    eta : n_outside / n_inside.

    Returns
    -------
    cos_outside, cos_inside : cosines of the passage to the normal.
    spread : d(omega)/dA, 1/mm2; 1/distance^2 for eta = 1.
    """
    low, high = 0.0, lateral / height
    if eta > 1.0:
        high = min(high, 1.0 / math.sqrt(eta * eta - 1.0))
    t = min(lateral / (height + depth), high)
    for _ in range(_ITERATIONS):
        cos_o = 1.0 / math.sqrt(1.0 + t * t)
        cos_i = math.sqrt(max(1e-30, 1.0 - eta * eta * t * t * cos_o * cos_o))
        excess = height * t + depth * eta * t * cos_o / cos_i - lateral
        slope = height + depth * eta * (cos_o / cos_i) ** 3
        if abs(excess) <= 1e-13 * (height + depth):
            break
        if excess > 0.0:
            high = t
        else:
            low = t
        t -= excess / slope
        if not low < t < high:
            t = 0.5 * (low + high)
    cos_o = 1.0 / math.sqrt(1.0 + t * t)
    cos_i = math.sqrt(max(1e-30, 1.0 - eta * eta * t * t * cos_o * cos_o))
    ratio = cos_o / cos_i
    spread = cos_o**3 / (cos_i * (height + depth * eta * ratio) * (height + depth * eta * ratio**3))
    return cos_o, cos_i, spread


@kernel
def connect(lamp, tile_x, tile_y, lx, ly, periodic, eta, x, y, z):
    """The passage from the lamp of a tile to (x, y, z), z >= 0.

    Returns
    -------
    strength : of the pencil per unit of intensity (1/mm2) or irradiance, before Fresnel; 0 when the passage enters
        outside the tile or the beam.
    entry_x, entry_y, dx, dy, dz, length, cos_outside : where it enters, its direction of flight inside, its length
        inside (mm), its cosine outside.
    """
    if lamp.is_point:
        to_x, to_y = x - (lamp.x + tile_x * lx), y - (lamp.y + tile_y * ly)
        lateral = math.sqrt(to_x * to_x + to_y * to_y)
        cos_o, dz, strength = refracted_pencil(lateral, lamp.height, z, eta)
        sin_i = math.sqrt(max(0.0, 1.0 - dz * dz))
        dx, dy = (sin_i * to_x / lateral, sin_i * to_y / lateral) if lateral > 0.0 else (0.0, 0.0)
    else:
        dx, dy, dz, cos_o = lamp.dx, lamp.dy, lamp.dz, lamp.cos_outside
        strength = cos_o / dz
    length = z / dz
    entry_x, entry_y = x - dx * length, y - dy * length
    from_x, from_y = entry_x - tile_x * lx, entry_y - tile_y * ly
    if periodic and not lamp.is_point:
        from_x, from_y = from_x - lx * math.floor(from_x / lx), from_y - ly * math.floor(from_y / ly)
    inside = 0.0 <= from_x <= lx and 0.0 <= from_y <= ly
    if lamp.radius < np.inf:
        off_x, off_y = from_x - lamp.x, from_y - lamp.y
        along = off_x * dx + off_y * dy
        sin2 = dx * dx + dy * dy
        squeeze = along * along / sin2 * (1.0 - cos_o * cos_o) if sin2 > 0.0 else 0.0
        inside = inside and off_x * off_x + off_y * off_y - squeeze <= lamp.radius * lamp.radius
    return strength if inside else 0.0, entry_x, entry_y, dx, dy, dz, length, cos_o
