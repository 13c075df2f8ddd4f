"""The lattice of view rays in the skin: which rays pass near a photon.

In each depth slab the rays' points form a bent copy of the pixel lattice. A regular lattice of bins, fitted to them,
tells for a photon which rays pass through its bin: one as a rule, several where refraction focuses, none where it
spreads. That makes the connection of a photon to the camera a table look-up, for any camera and relief.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinrender.estimate.ray_paths import RayPaths
from skinrender.transport import allocating_kernel, kernel

NO_RAY, SEVERAL_RAYS = -1, -2


@dataclass(frozen=True, eq=False)
class RayLattice:
    """The rays of the pixels' centers, row by row, sorted into bins; S slabs, lengths in mm.

    Parameters
    ----------
    shape : (h, w).
    rays : the Q = h w rays.
    to_lattice : (S, 2, 3) affine map from (x, y) to fractional (row, column) of the slab's bins.
    bin_area : (S,) mm2.
    bin_start : (S, h w + 1), ray_of : (S, Q) rays of each bin.
    only_ray : (S, h w) the one ray of a bin, `NO_RAY`, or `SEVERAL_RAYS`: most photons need to look no further.
    bounds : (S, 4) lowest and highest x and y of the slab's bins, for the periodic images of a photon.
    """

    shape: tuple[int, int]
    rays: RayPaths
    to_lattice: np.ndarray
    bin_area: np.ndarray
    bin_start: np.ndarray
    ray_of: np.ndarray
    only_ray: np.ndarray
    bounds: np.ndarray

    @property
    def spacing_mm(self) -> float:
        """Distance of neighboring rays at the surface."""
        return float(np.sqrt(self.bin_area[0]))

    @cached_property
    def point_in_bins(self) -> np.ndarray:
        """Where the rays of `ray_of` pass, (S, Q, 2) f4: neighbors in the picture are neighbors in memory."""
        return np.take_along_axis(self.rays.point.astype(np.float32), self.ray_of[:, :, None], axis=1)

    @cached_property
    def nearest_ray(self) -> np.ndarray:
        """A ray of each bin, (S, h w) int32; where it has none, of the nearest bin that has."""
        from scipy.ndimage import distance_transform_edt

        first = np.minimum(self.bin_start[:, :-1], self.ray_of.shape[1] - 1)
        nearest = np.take_along_axis(self.ray_of, first, axis=1)
        for slab, empty in enumerate(np.diff(self.bin_start, axis=1) == 0):
            if empty.any() and not empty.all():
                row, column = distance_transform_edt(
                    empty.reshape(self.shape), return_distances=False, return_indices=True
                )
                nearest[slab] = nearest[slab].reshape(self.shape)[row, column].ravel()
        return nearest


def lattice_bytes(rays: int, slabs: int) -> int:
    """Size in memory of a `RayLattice` beside its rays."""
    return 12 * rays * slabs


def make_lattice(rays: RayPaths, shape: tuple[int, int], plane: np.ndarray) -> RayLattice:
    """Sort the rays of an (h, w) picture into bins.

    plane (2, 3) : affine map from (x, y) on the mean plane to fractional (row, column), for when the rays that hit lie on
        a line and don't tell.
    """
    maps = _fit_bins(rays.point, rays.hit, shape, plane)
    start, order = _sort_rays(rays.point, rays.hit, maps, *shape)
    area = 1.0 / np.abs(np.linalg.det(maps[:, :, :2]))
    held = np.diff(start, axis=1)
    first = np.take_along_axis(order, np.minimum(start[:, :-1], order.shape[1] - 1), axis=1)
    only = np.where(held == 1, first, np.where(held == 0, NO_RAY, SEVERAL_RAYS)).astype(np.int32)
    return RayLattice(shape, rays, maps, area, start, order, only, np.array([_bin_bounds(m, shape) for m in maps]))


def fit_plane(point: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Affine map (2, 3) from points (Q, 2) to cells (Q, 2), fractional (row, column): least squares.

    About the points' mean and in units of their spread, so that neither place nor size costs digits.
    """
    middle, spread = point.mean(axis=0), np.ptp(point, axis=0).max()
    local, centered = (point - middle) / spread, cell - cell.mean(axis=0)
    linear = np.linalg.solve(local.T @ local, local.T @ centered).T / spread
    return np.column_stack([linear, cell.mean(axis=0) - linear @ middle])


def _fit_bins(point: np.ndarray, hit: np.ndarray, shape: tuple[int, int], plane: np.ndarray) -> np.ndarray:
    """Affine maps (S, 2, 3) from (x, y) to fractional (row, column), fitted to the points (S, Q, 2) of rays that hit."""
    if not hit.any():
        return np.tile(plane, (len(point), 1, 1))
    cell = np.column_stack(np.divmod(np.flatnonzero(hit), shape[1])).astype(float)
    spread = cell - cell.mean(axis=0)
    seen = point if hit.all() else point[:, hit]
    if np.linalg.matrix_rank(spread.T @ spread) == 2:
        return np.array([fit_plane(points, cell) for points in seen])
    shifts = [(cell - points @ plane[:, :2].T).mean(axis=0) for points in seen]
    return np.array([np.column_stack([plane[:, :2], shift]) for shift in shifts])


def _bin_bounds(to_lattice: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Lowest and highest x and y of the lattice's bins: (4,)."""
    h, w = shape
    corners = np.array([[-0.5, -0.5], [h - 0.5, -0.5], [-0.5, w - 0.5], [h - 0.5, w - 0.5]])
    xy = np.linalg.solve(to_lattice[:, :2], (corners - to_lattice[:, 2]).T).T
    return np.concatenate([xy.min(axis=0), xy.max(axis=0)])


@kernel
def bin_of(to_lattice, slab, x, y, h, w):
    """Bin of the point (x, y) in a slab, or -1 outside the lattice."""
    m = to_lattice
    row = int(np.floor(m[slab, 0, 0] * x + m[slab, 0, 1] * y + m[slab, 0, 2] + 0.5))
    column = int(np.floor(m[slab, 1, 0] * x + m[slab, 1, 1] * y + m[slab, 1, 2] + 0.5))
    if row < 0 or row >= h or column < 0 or column >= w:
        return -1
    return row * w + column


@allocating_kernel
def _sort_rays(point, hit, to_lattice, h, w):
    """Rays by bin: start (S, h w + 1) and rays (S, Q) (counting sort)."""
    slabs, count = point.shape[0], point.shape[1]
    start = np.zeros((slabs, h * w + 1), np.int32)
    rays = np.zeros((slabs, count), np.int32)
    own = np.empty(count, np.int32)
    for s in range(slabs):
        for q in range(count):
            own[q] = bin_of(to_lattice, s, point[s, q, 0], point[s, q, 1], h, w) if hit[q] else -1
            if own[q] >= 0:
                start[s, own[q] + 1] += 1
        for k in range(h * w):
            start[s, k + 1] += start[s, k]
        cursor = start[s, :-1].copy()
        for q in range(count):
            if own[q] >= 0:
                rays[s, cursor[own[q]]] = q
                cursor[own[q]] += 1
    return start, rays
