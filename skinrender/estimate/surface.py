"""Light that the skin's surface itself reflects into the view: a rough dielectric of microfacets.

GGX facets, Smith's shadowing of correlated heights, Fresnel at the facet, per band; a share `oil` of the reflection is
that of a smoother film. On a relief the mean facet is the relief's own normal and a shadow ray is cast.

Sources: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007; Heitz, "Sampling the GGX
Distribution of Visible Normals", JCGT 7(4), 2018.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skinrender.estimate.view_path import Meeting, relief_arrays
from skinrender.photonmap.light import CollimatedLight, Light, PointLight, SkyLight
from skinrender.skin.regions import regions_of
from skinrender.transport import allocating_kernel, entry_kernel, kernel
from skinrender.transport.frame import frame
from skinrender.transport.fresnel import fresnel
from skinrender.transport.height_field import first_hit, height_and_gradient

OIL_ROUGHNESS = 0.1
_SKY_SAMPLES = 64


def surface_bytes(rays: int, pixels: int, bands: int) -> int:
    """Most that the reflection of so many rays holds: where they meet the surface and the lamp, and the pixels' sums."""
    return 8 * (24 * rays + 2 * pixels * bands)


def irradiance(light: Light, points: np.ndarray, size_mm: tuple[float, float], periodic: bool) -> np.ndarray:
    """Irradiance on the mean plane z = 0, nothing in the way, (..., B) W/mm2.

    Parameters
    ----------
    points : (..., 2) or (..., 3), mm; x and y are used.
    periodic : whether every tile has its own copy of the lamp. Else a point beyond the patch gets the one lamp's.

    A pencil has no irradiance and gives 0.
    """
    xy = np.asarray(points, dtype=float)[..., :2]
    if isinstance(light, SkyLight):
        return np.broadcast_to(math.pi * light.radiance, (*xy.shape[:-1], light.radiance.size)).copy()
    if periodic:
        xy = np.mod(xy, size_mm)
    if isinstance(light, PointLight):
        height = -light.position_mm[2]
        distance2 = np.sum((xy - light.position_mm[:2]) ** 2, axis=-1) + height**2
        return (height / distance2**1.5)[..., None] * light.intensity
    share = np.where(in_beam(light, xy), light.direction[2], 0.0)
    return share[..., None] * light.irradiance


def in_beam(light: CollimatedLight, points: np.ndarray) -> np.ndarray:
    """Whether points (..., 2) on the mean plane lie in the beam, (...,) bool."""
    if light.radius_mm is None:
        return np.ones(points.shape[:-1], dtype=bool)
    if light.radius_mm == 0.0:
        return np.zeros(points.shape[:-1], dtype=bool)
    offset = points - light.position_mm
    along = offset @ light.direction[:2]
    return np.sum(offset**2, axis=-1) - along**2 <= light.radius_mm**2


def surface_reflection(view: Meeting, pixel_of: np.ndarray, volume: Any, light: Light, finish: Any) -> np.ndarray:
    """Radiance of the lamp's light reflected at the surface into the view, mean over each pixel's rays, (pixels, B)
    W/mm2/sr in the band.

    A cross-polarized camera does not see it: leave the term out then.

    Parameters
    ----------
    pixel_of : (Q,) of each ray; as many rays in every pixel.
    finish : the scene's finish: `roughness` (GGX alpha) and `oil` (share of the film's smoother reflection).
    """
    eta = np.ascontiguousarray(volume.n_outside / regions_of(volume).index[1])
    relief = None if volume.surface_mm is None else _relief(volume.surface_mm)
    lx, ly = map(float, volume.size_mm)
    point = _in_patch(view.entry, volume)
    pixels = int(pixel_of.max()) + 1
    result = np.zeros((pixels, eta.size))
    lobes = [(1.0 - finish.oil, float(finish.roughness)), (finish.oil, min(OIL_ROUGHNESS, float(finish.roughness)))]
    if isinstance(light, SkyLight):
        add, lamp = _add_sky, (_strata(_SKY_SAMPLES), light.radiance)
    else:
        add, lamp = _add_lamp, (*_toward_lamp(light, point), _spectrum(light))
    for share, alpha in lobes:
        if share > 0.0:
            weight = share * pixels / len(pixel_of)
            add(result, pixel_of, weight, view.hit, point, view.normal, view.view_direction, *lamp, eta, alpha, relief, lx, ly)
    return result


def has_direction(light: Light) -> bool:
    """Whether the light comes to a point from one direction, as that of a lamp does."""
    return not isinstance(light, SkyLight)


def entering_light(entry: np.ndarray, hit: np.ndarray, volume: Any, light: PointLight | CollimatedLight) -> np.ndarray:
    """Light of a lamp that enters a relief at some points, W per mm2 of the mean plane, all bands, (Q,).

    entry (Q, 3), hit (Q,) : points of the surface, and which are.
    """
    relief, (lx, ly) = _relief(volume.surface_mm), map(float, volume.size_mm)
    point = _in_patch(entry, volume)
    to_light, distance, strength = _toward_lamp(light, point)
    eta = float(np.median(volume.n_outside / regions_of(volume).index[1]))
    return _spectrum(light).sum() * strength * _entering_share(hit, point, to_light, distance, eta, relief, lx, ly)


@allocating_kernel
def _entering_share(hit, point, to_light, distance, eta, relief, lx, ly):
    """Part of the irradiance across the lamp's light that enters above an area of the mean plane, (Q,)."""
    share = np.zeros(hit.size)
    for q in range(hit.size):
        dx, dy, dz = to_light[q]
        _, slope_x, slope_y = height_and_gradient(relief[0], lx, ly, point[q, 0], point[q, 1])
        projected = slope_x * dx + slope_y * dy - dz
        if not hit[q] or projected <= 0.0 or _is_shadowed(relief, lx, ly, point[q], dx, dy, dz, distance[q]):
            continue
        cosine = projected / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        share[q] = projected * (1.0 - fresnel(min(1.0, cosine), eta)[0])
    return share


def _relief(surface_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A relief as the shadow rays read it, with the z above which nothing stands."""
    heights, cells = relief_arrays(surface_mm)
    return heights, cells, float(heights.min()) - 1e-3


def _in_patch(entry: np.ndarray, volume: Any) -> np.ndarray:
    """Points (Q, 3), those of periodic copies moved into the patch."""
    foot = np.mod(entry[:, :2], volume.size_mm) if volume.sides == "periodic" else entry[:, :2]
    return np.ascontiguousarray(np.column_stack([foot, entry[:, 2]]))


def _toward_lamp(light: PointLight | CollimatedLight, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the lamp (Q, 3), distances (Q,) and the light across them, in units of `_spectrum`, (Q,)."""
    if isinstance(light, PointLight):
        away = light.position_mm - point
        distance = np.linalg.norm(away, axis=1)
        return away / distance[:, None], distance, 1.0 / distance**2
    to_light = np.tile(-light.direction, (len(point), 1))
    # the foot of the light through the point on the mean plane says whether the beam holds it
    foot = point[:, :2] - point[:, 2:] * (light.direction[:2] / light.direction[2])
    return to_light, np.full(len(point), np.inf), in_beam(light, foot).astype(float)


def _spectrum(light: PointLight | CollimatedLight) -> np.ndarray:
    """Irradiance (B,) of a beam, or of a point lamp 1 mm away."""
    return light.intensity if isinstance(light, PointLight) else light.irradiance


def _strata(count: int) -> np.ndarray:
    """Points (count, 2) of the unit square, evenly spread (Fibonacci lattice)."""
    k = np.arange(count)
    return np.column_stack([(k + 0.5) / count, np.mod((k + 0.5) * (0.5 * (math.sqrt(5.0) - 1.0)), 1.0)])


@kernel
def _is_shadowed(relief, lx, ly, point, dx, dy, dz, distance):
    """Whether the relief stands between a point of it and what lies at a distance in the unit direction d."""
    if dz >= 0.0:
        return True
    if relief is None:
        return False
    heights, cells, highest = relief
    reach = min(distance, (highest - point[2]) / dz)
    return first_hit(heights, cells, lx, ly, point[0], point[1], point[2], dx, dy, dz, reach, -1.0) >= 0.0


@kernel
def _smith_lambda(cos_theta, alpha):
    """Smith's Lambda of GGX at a cosine to the mean normal."""
    tan2 = (1.0 - cos_theta) * (1.0 + cos_theta) / (cos_theta * cos_theta)
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * max(0.0, tan2)) - 1.0)


@kernel
def microfacet(cos_v, cos_l, cos_h, alpha):
    """D G / (4 cos_v): the microfacet reflectance times the light's cosine, before Fresnel, 1/sr.

    cos_v, cos_l, cos_h: cosines of view, light and their bisector to the mean normal.
    """
    stretch = cos_h * cos_h * (alpha * alpha - 1.0) + 1.0
    facets = alpha * alpha / (math.pi * stretch * stretch)
    seen = 1.0 / (1.0 + _smith_lambda(cos_v, alpha) + _smith_lambda(cos_l, alpha))
    return facets * seen / (4.0 * cos_v)


@entry_kernel
def _add_lamp(
    result, pixel_of, weight, hit, point, normal, view, to_light, distance, strength, spectrum, eta, alpha, relief, lx, ly
):
    """Adds `weight` times the reflected radiance of the rays (Q,) to that of their pixels, (pixels, B)."""
    for q in range(hit.size):
        vx, vy, vz = -view[q, 0], -view[q, 1], -view[q, 2]
        dx, dy, dz = to_light[q]
        nx, ny, nz = normal[q]
        cos_v, cos_l = vx * nx + vy * ny + vz * nz, dx * nx + dy * ny + dz * nz
        if not hit[q] or cos_v <= 0.0 or cos_l <= 0.0:
            continue
        if _is_shadowed(relief, lx, ly, point[q], dx, dy, dz, distance[q]):
            continue
        # 1 + v.l, not v + l itself, keeps the facet's cosine when the light comes almost against the view
        double = math.sqrt(max(1e-30, 2.0 + 2.0 * (vx * dx + vy * dy + vz * dz)))
        value = microfacet(cos_v, cos_l, min(1.0, (cos_v + cos_l) / double), alpha)
        _add_fresnel(result[pixel_of[q]], weight * strength[q] * value, spectrum, min(1.0, 0.5 * double), eta)


@entry_kernel
def _add_sky(result, pixel_of, weight, hit, point, normal, view, samples, spectrum, eta, alpha, relief, lx, ly):
    """Adds `weight` times the reflected radiance of the rays (Q,) to that of their pixels, (pixels, B): quadrature over
    the visible facets; spectrum : (B,) radiance of the sky."""
    for q in range(hit.size):
        vx, vy, vz = -view[q, 0], -view[q, 1], -view[q, 2]
        nx, ny, nz = normal[q]
        cos_v = vx * nx + vy * ny + vz * nz
        if not hit[q] or cos_v <= 0.0:
            continue
        tx, ty, tz, bx, by, bz = frame(nx, ny, nz)
        local_x, local_y = vx * tx + vy * ty + vz * tz, vx * bx + vy * by + vz * bz
        own = _smith_lambda(cos_v, alpha)
        for k in range(samples.shape[0]):
            fx, fy, fz = _visible_facet(local_x, local_y, cos_v, alpha, samples[k, 0], samples[k, 1])
            cos_f = local_x * fx + local_y * fy + cos_v * fz
            cos_l = 2.0 * cos_f * fz - cos_v
            if cos_l <= 0.0 or cos_f <= 0.0:
                continue
            mx, my = 2.0 * cos_f * fx - local_x, 2.0 * cos_f * fy - local_y
            dx, dy, dz = mx * tx + my * bx + cos_l * nx, mx * ty + my * by + cos_l * ny, mx * tz + my * bz + cos_l * nz
            if _is_shadowed(relief, lx, ly, point[q], dx, dy, dz, np.inf):
                continue
            seen = (1.0 + own) / (1.0 + own + _smith_lambda(cos_l, alpha))
            _add_fresnel(result[pixel_of[q]], weight * seen / samples.shape[0], spectrum, min(1.0, cos_f), eta)


@kernel
def _visible_facet(vx, vy, vz, alpha, u, v):
    """Normal of a facet visible from the local unit direction (vx, vy, vz), z along the mean normal."""
    sx, sy, sz = alpha * vx, alpha * vy, vz
    inverse = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx * inverse, sy * inverse, sz * inverse
    lateral = math.sqrt(sx * sx + sy * sy)
    ax, ay = (-sy / lateral, sx / lateral) if lateral > 1e-12 else (1.0, 0.0)
    bx, by, bz = -sz * ay, sz * ax, lateral
    # a uniform point of the disc, squeezed to the projection of the facets' hemisphere as seen from the view
    radius, angle = math.sqrt(u), 2.0 * math.pi * v
    p = radius * math.cos(angle)
    squeeze = 0.5 * (1.0 + sz)
    across = (1.0 - squeeze) * math.sqrt(max(0.0, 1.0 - p * p)) + squeeze * radius * math.sin(angle)
    up = math.sqrt(max(0.0, 1.0 - p * p - across * across))
    fx, fy = alpha * (p * ax + across * bx + up * sx), alpha * (p * ay + across * by + up * sy)
    fz = max(0.0, across * bz + up * sz)
    norm = 1.0 / math.sqrt(fx * fx + fy * fy + fz * fz)
    return fx * norm, fy * norm, fz * norm


@kernel
def _add_fresnel(row, value, spectrum, cos_facet, eta):
    """Add value * spectrum * F per band; equal indices are not computed again."""
    before, reflectance = -1.0, 0.0
    for b in range(eta.size):
        if eta[b] != before:
            before, reflectance = eta[b], fresnel(cos_facet, eta[b])[0]
        row[b] += value * spectrum[b] * reflectance
