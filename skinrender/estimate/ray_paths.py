"""View rays inside the skin: refracted at every border, followed from slab to slab of equal depth (paper, section 7.2).

Depth D is measured below the surface straight above, so a slab follows the relief as the tissue does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinrender.estimate.view_path import LEVEL, geometry_band, make_view_path, relief_arrays
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume
from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.fresnel import fresnel, refract
from skinrender.transport.height_field import height_and_gradient

VISIBLE_DEPTH = 8.0
"""Optical depth that is looked at: 7.5 hold all but 0.04 % of the light, 8 all but 0.02 %."""
LEAST_DESCENT = 0.2
"""Smallest |dD/ds| of a ray that is weighted exactly; a ray that runs along a furrow's wall is given this one."""


@dataclass(frozen=True, eq=False)
class RayPaths:
    """Q view rays through S depth slabs and R regions; lengths in mm.

    Parameters
    ----------
    depth_edges_mm : (S + 1,) depths below the surface.
    region : (S,) region of each slab.
    hit : (Q,) bool, rays that meet the skin.
    entry : (Q, 3) where they do.
    direction : (R, Q, 3) f4 direction of the ray in each region.
    transmission : (R, Q, B) factor from radiance in the region to radiance outside.
    path_edges : (S + 1, Q) path length inside at which the ray reaches the slab's edges.
    point : (S, Q, 2) x and y where the ray passes the middle of the slab, not wrapped.
    descent : (S, Q) f4, dD/ds of the ray in the slab.
    """

    depth_edges_mm: np.ndarray
    region: np.ndarray
    hit: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    transmission: np.ndarray
    path_edges: np.ndarray
    point: np.ndarray
    descent: np.ndarray

    @property
    def slabs(self) -> int:
        return len(self.region)


def paths_bytes(rays: int, slabs: int, regions: int, bands: int) -> int:
    """Size in memory of the `RayPaths` of so many rays; while they are made, their transmissions are held twice."""
    return rays * (28 * slabs + 8 * bands * regions + 12 * regions + 40)


def visible_depth_mm(volume: SkinVolume) -> float:
    """Depth at which the clearest band of the clearest column is `VISIBLE_DEPTH` optical depths away."""
    mu_t = volume.mu_a + volume.mu_s
    tissue = volume.palette_layer > 0
    z = volume.z_edges_mm
    depth, reached = np.zeros(mu_t.shape[1]), 0.0
    for k in range(len(z) - 1):
        held = volume.plane_holds[k] & tissue
        if z[k + 1] <= 0 or not held.any():
            continue
        top = max(z[k], 0.0)
        clearest = mu_t[held].min(axis=0)
        thickness = z[k + 1] - top
        if np.all(depth + clearest * thickness >= VISIBLE_DEPTH):
            remaining = (VISIBLE_DEPTH - depth) / np.maximum(clearest, 1e-30)
            return float(top + remaining.max())
        depth += clearest * thickness
        reached = z[k + 1]
    return float(reached)


def slab_edges(volume: SkinVolume, least_cosine: float = 1.0, thickest: float = 0.3) -> np.ndarray:
    """Edges of the depth slabs: the layers' borders, cut finer near the surface, down to the visible depth.

    least_cosine : of the rays inside; level ones (without an index step) see a fraction of a free path deep.
    Within a slab a ray's optical depth is interpolated linearly, which is exact between borders; thin slabs keep the
    change of tissue across a wavy border and the tilt of the ray within a bin.
    """
    deepest = visible_depth_mm(volume)
    borders = volume.border_z_mm
    edges, thinnest = [0.0], 0.04 * min(1.0, 2.0 * least_cosine) * deepest
    stops = [*borders[(borders > 1e-9) & (borders < deepest)], deepest]
    for stop in stops:
        while edges[-1] < stop * (1 - 1e-9):
            step = max(thinnest, thickest * edges[-1])
            parts = max(1, int(np.ceil((stop - edges[-1]) / step)))
            edges.append(edges[-1] + (stop - edges[-1]) / parts)
        edges[-1] = stop
    return np.array(edges)


def follow_rays(origin: np.ndarray, direction: np.ndarray, volume: SkinVolume, edges: np.ndarray) -> RayPaths:
    """Follow view rays (..., 3) through the slabs given by their edges."""
    path = make_view_path(origin, direction, volume)
    regions = regions_of(volume)
    region = np.searchsorted(regions.border_z_mm[1:-1], 0.5 * (edges[1:] + edges[:-1]), side="right")
    directions, transmission = _through_regions(path, regions.index, geometry_band(volume.wavelength_nm))
    relief = None if volume.surface_mm is None else relief_arrays(volume.surface_mm)[0]
    path_edges, point, descent = _depths(path.entry, directions, path.hit, edges, region, relief, *volume.size_mm)
    if relief is not None:
        descent = np.maximum(descent, LEAST_DESCENT)
    directions, descent = directions.astype(np.float32), descent.astype(np.float32)
    return RayPaths(edges, region, path.hit, path.entry, directions, transmission, path_edges, point, descent)


def _through_regions(path, index: np.ndarray, band: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (R, Q, 3) and transmissions (R, Q, B) through flat inner borders below the surface."""
    regions = len(index) - 2
    directions, factors = [path.direction], [path.transmission]
    for r in range(1, regions):
        eta = np.ascontiguousarray(index[r] / index[r + 1])
        direction, factor = refract_flat(directions[-1], path.hit, eta, band)
        directions.append(direction)
        factors.append(factors[-1] * factor)
    return np.array(directions), np.array(factors) if len(factors) > 1 else factors[0][np.newaxis]


@allocating_kernel
def refract_flat(direction, hit, eta, band):
    """Directions (Q, 3) below a level border and the factors (1 - F) eta^2 (Q, B); eta = n_above / n_below."""
    below, factor = np.zeros_like(direction), np.zeros((direction.shape[0], eta.size))
    for q in range(direction.shape[0]):
        if hit[q]:
            ux, uy, uz = direction[q]
            for b in range(eta.size):
                factor[q, b] = (1.0 - fresnel(uz, eta[b])[0]) * eta[b] * eta[b]
            cos_t = fresnel(uz, eta[band])[1]
            if cos_t == 0.0:
                continue
            below[q, 0], below[q, 1], below[q, 2] = refract(ux, uy, uz, 0.0, 0.0, 1.0, eta[band], uz, cos_t)
    return below, factor


@allocating_kernel
def _depths(entry, direction, hit, edges, region, relief, lx, ly):
    """Path lengths to the edges (S + 1, Q), points in mid-slab (S, Q, 2) and dD/ds there (S, Q)."""
    slabs, count = edges.size - 1, entry.shape[0]
    path_edges = np.zeros((slabs + 1, count))
    point = np.zeros((slabs, count, 2))
    descent = np.ones((slabs, count))
    for q in range(count):
        if not hit[q]:
            continue
        x, y, z = entry[q]
        length = 0.0
        for s in range(slabs):
            ux, uy, uz = direction[region[s], q]
            for half in range(2):
                depth = edges[s + 1] if half else 0.5 * (edges[s] + edges[s + 1])
                step, slope = _reach(x, y, z, ux, uy, uz, depth, relief, lx, ly)
                if not half:
                    point[s, q, 0], point[s, q, 1] = x + step * ux, y + step * uy
                    descent[s, q] = slope
            x, y, z = x + step * ux, y + step * uy, z + step * uz
            length += step
            path_edges[s + 1, q] = length
    return path_edges, point, descent


@kernel
def _reach(x, y, z, ux, uy, uz, depth, relief, lx, ly):
    """Path length from (x, y, z) to the first depth D = `depth`, and dD/ds there (Newton steps, never backwards)."""
    if relief is None:
        return (max(0.0, (depth - z) / uz), uz) if uz > LEVEL else (0.0, 1.0)
    step, slope = 0.0, uz
    for _ in range(8):
        h, hx, hy = height_and_gradient(relief, lx, ly, x + step * ux, y + step * uy)
        slope = uz - ux * hx - uy * hy
        missing = depth - (z + step * uz - h)
        if abs(missing) < 1e-7:
            break
        step = max(0.0, step + missing / max(slope, LEAST_DESCENT))
    return step, slope
