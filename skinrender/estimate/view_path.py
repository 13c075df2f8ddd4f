"""What a view ray meets: the skin's surface, its normal there, and the refracted ray inside.

Geometry is made once, at the band nearest 550 nm; the Fresnel factors are those of each band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinrender.skin.regions import regions_of
from skinrender.transport import allocating_kernel
from skinrender.transport.fresnel import fresnel, refract
from skinrender.transport.height_field import cell_bounds, first_hit, height_and_gradient, slab_interval

GEOMETRY_NM = 550.0
_ABOVE_MM = 1e-3
"""A ray begins this far from where the relief may be."""
LEVEL = 1e-6
"""Cosine below which a ray under a flat border goes nowhere: total reflection, or grazing beyond any camera."""


@dataclass(frozen=True)
class Meeting:
    """Where view rays meet the skin's surface, flattened over the ray lattice (Q = h w).

    Attributes
    ----------
    hit : (Q,) bool, whether the ray meets the patch; all else is 0 where it does not.
    entry : (Q, 3), mm, on the surface; not wrapped into the patch when the sides are periodic.
    normal : (Q, 3), unit, out of the skin (z < 0).
    view_direction : (Q, 3), unit, the ray's direction outside, towards the skin.
    """

    hit: np.ndarray
    entry: np.ndarray
    normal: np.ndarray
    view_direction: np.ndarray


@dataclass(frozen=True)
class ViewPath(Meeting):
    """View rays refracted into the skin.

    Attributes
    ----------
    direction : (Q, 3), unit, the refracted ray's, into the skin.
    cos_inside : (Q,) cosine of `direction` to the inward normal.
    transmission : (Q, B) factor from radiance under the surface to radiance outside,
        (1 - F) (n_outside / n_tissue)^2.
    """

    direction: np.ndarray
    cos_inside: np.ndarray
    transmission: np.ndarray


def geometry_band(wavelength_nm: np.ndarray) -> int:
    """Index of the band whose refractive indices bend the rays: the nearest to 550 nm."""
    return int(np.argmin(np.abs(np.asarray(wavelength_nm) - GEOMETRY_NM)))


def dispersion_mm(volume: Any, zenith_deg: float, depth_mm: float) -> float:
    """How far aside a ray of any band is at a depth of a flat surface from the one that all bands share."""
    eta = volume.n_outside / regions_of(volume).index[1]
    sine = eta * math.sin(math.radians(zenith_deg))
    aside = depth_mm * sine / np.sqrt(np.maximum(1.0 - sine**2, 1e-12))
    return float(np.abs(aside - aside[geometry_band(volume.wavelength_nm)]).max())


def make_view_path(origin: np.ndarray, direction: np.ndarray, volume: Any) -> ViewPath:
    """Follow view rays to the surface of a skin volume and refract them there; parameters as of `meet_surface`."""
    met = meet_surface(origin, direction, volume)
    eta = np.ascontiguousarray(volume.n_outside / regions_of(volume).index[1])
    inside = _refract_rays(met.view_direction, met.normal, met.hit, eta, geometry_band(volume.wavelength_nm))
    return ViewPath(met.hit, met.entry, met.normal, met.view_direction, *inside)


def meet_surface(origin: np.ndarray, direction: np.ndarray, volume: Any) -> Meeting:
    """Follow view rays to the surface of a skin volume.

    Parameters
    ----------
    origin, direction : (..., 3), mm and unit vectors, starting above the skin.
    volume : SkinVolume.
    """
    origin = np.ascontiguousarray(origin, dtype=np.float64).reshape(-1, 3)
    direction = np.ascontiguousarray(direction, dtype=np.float64).reshape(-1, 3)
    lx, ly = volume.size_mm
    if volume.surface_mm is None:
        entry, normal, hit = _meet_plane(origin, direction)
    else:
        heights, cells = relief_arrays(volume.surface_mm)
        within = float(cells[..., 0].min()) - _ABOVE_MM, float(cells[..., 1].max()) + _ABOVE_MM
        entry, normal, hit = _meet_relief(origin, direction, heights, cells, *within, lx, ly)
    if volume.sides != "periodic":
        hit &= (entry[:, 0] >= 0.0) & (entry[:, 0] <= lx) & (entry[:, 1] >= 0.0) & (entry[:, 1] <= ly)
    for values in (entry, normal):
        values[~hit] = 0.0
    return Meeting(hit, entry, normal, np.where(hit[:, None], direction, 0.0))


def relief_arrays(surface_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Control points and cell bounds of a relief as the kernels read them, in the walk's float32: no second copy of them."""
    heights = np.array(surface_mm, dtype=np.float32, order="C")  # a read-only one would be another type to the kernels
    return heights, cell_bounds(heights)


def _meet_plane(origin, direction):
    """Entry points and normals on the plane z = 0."""
    hit = (direction[:, 2] > 0.0) & (origin[:, 2] <= 0.0)
    s = np.divide(-origin[:, 2], direction[:, 2], out=np.zeros(len(origin)), where=hit)
    entry = origin + s[:, None] * direction
    entry[:, 2] = 0.0
    return entry, np.tile([0.0, 0.0, -1.0], (len(origin), 1)), hit


@allocating_kernel
def _meet_relief(origin, direction, heights, cells, z_low, z_high, lx, ly):
    """Entry points (Q, 3), outward normals (Q, 3) and hits (Q,) of rays from above on a relief within z_low..z_high."""
    count = origin.shape[0]
    entry, normal, hit = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, np.bool_)
    for q in range(count):
        ux, uy, uz = direction[q]
        begin, end = slab_interval(origin[q, 2], uz, z_low, z_high, np.inf)
        if not begin <= end < np.inf:
            continue
        x, y, z = origin[q, 0] + begin * ux, origin[q, 1] + begin * uy, origin[q, 2] + begin * uz
        s = first_hit(heights, cells, lx, ly, x, y, z, ux, uy, uz, end - begin, -1.0)
        if s < 0.0:
            continue
        hit[q] = True
        entry[q, 0], entry[q, 1] = x + s * ux, y + s * uy
        h, slope_x, slope_y = height_and_gradient(heights, lx, ly, entry[q, 0], entry[q, 1])
        entry[q, 2] = h
        norm = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        normal[q, 0], normal[q, 1], normal[q, 2] = slope_x * norm, slope_y * norm, -norm
    return entry, normal, hit


@allocating_kernel
def _refract_rays(direction, normal, hit, eta, band):
    """Refracted directions (Q, 3), their cosines (Q,) and the factors (1 - F) eta^2 (Q, B); eta = n_outside / n."""
    count, bands = direction.shape[0], eta.size
    inside, cosine, factor = np.zeros((count, 3)), np.zeros(count), np.zeros((count, bands))
    for q in range(count):
        if not hit[q]:
            continue
        ux, uy, uz = direction[q]
        nx, ny, nz = -normal[q, 0], -normal[q, 1], -normal[q, 2]
        cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
        for b in range(bands):
            factor[q, b] = (1.0 - fresnel(cos_i, eta[b])[0]) * eta[b] * eta[b]
        cos_t = fresnel(cos_i, eta[band])[1]
        if cos_t == 0.0:  # total reflection: no direction inside, as the ray has no light from there
            continue
        cosine[q] = cos_t
        inside[q, 0], inside[q, 1], inside[q, 2] = refract(ux, uy, uz, nx, ny, nz, eta[band], cos_i, cos_t)
    return inside, cosine, factor
