"""The reference estimate of the multiply scattered light: every photon is connected to the camera, exactly and once.

With X(u, v, s) the point at path length s along the view ray that the film point (u, v) sees, a pixel shows

    L = 1/A int_pixel du dv int ds (1 - F)/n^2 exp(-tau) J(X, -w)
      = 1/A sum_i Phi_i sum_{(u, v, s): X = x_i} (1 - F)/n^2 exp(-tau) p(w_i . -w) / |det dX/d(u, v, s)|

as the stored photons sample the in-scattered light J. The pixel's own box is the only kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skinrender.estimate.connect_flat import Tissue, deposit_flat
from skinrender.estimate.connect_relief import deposit_relief
from skinrender.estimate.film_plane import FilmPlane, footprint_mm, make_film_plane
from skinrender.estimate.left_out import share_left_out
from skinrender.estimate.ray_mesh import make_ray_mesh
from skinrender.estimate.scatter_image import MOST_BATCHES, BandsLight, batches_of
from skinrender.estimate.single import merge_planes
from skinrender.estimate.stream import over_batches, roulette_table
from skinrender.estimate.view_path import relief_arrays
from skinrender.film.camera import view_rays
from skinrender.photonmap.first_scattering import is_laterally_uniform
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume

DEEPEST = 12.0
"""Optical depth down to which photons are connected; the light from below is less than 1e-5."""
REFINE = 4
"""Mesh cells along each side of a spline cell of the surface."""
LEAST = 0.3
"""Contributions below this share of an unattenuated, isotropic one are left to chance."""
MESH_BATCHES = slice(0, None, 4)
"""Batches that are looked at through a mesh of half the width too, to know what the mesh's width does."""

_VIEW_RAYS = 20_000
_SLACK = 1e-6
_BYTES_PER_CELL = 8 * (3 + 10 * 4 // 3)  # a node, and ten bounds in a pyramid


def reference_bytes(camera: Any, volume: SkinVolume, pixels: int, bands: int, rounds: int, threads: int) -> int:
    """What `estimate_reference` holds: images of batches and threads, the picture, and on a relief the finer mesh."""
    held = 8 * pixels * (min(rounds, MOST_BATCHES) + 3 * threads) + 4 * pixels * bands
    if volume.has_relief:
        surface = np.asarray(volume.surface_mm)
        box = footprint_mm(make_film_plane(camera, volume.size_mm), float(surface.min()), float(surface.max()))
        cells = np.ceil((box[2:] - box[:2]) / volume.size_mm * surface.shape) + 2
        held += int(np.prod(2 * REFINE * cells)) * _BYTES_PER_CELL
    return held


@dataclass(frozen=True, eq=False)
class Reference:
    """What the connections of all bands have in common.

    Parameters
    ----------
    camera : the scene's.
    y_weight : (B,) luminance of one W mm^-2 sr^-1 in each band.
    pool : who works; progress : called with the number of photons done.
    """

    camera: Any
    volume: SkinVolume
    photon_map: PhotonMap
    y_weight: np.ndarray
    pool: ThreadPoolExecutor
    progress: Callable[[int], None]

    @cached_property
    def film(self) -> FilmPlane:
        """The camera."""
        return make_film_plane(self.camera, self.volume.size_mm)

    @cached_property
    def relief(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Surface and bounds of its cells, None when flat."""
        return None if self.volume.surface_mm is None else relief_arrays(self.volume.surface_mm)

    @cached_property
    def voxels(self) -> tuple[np.ndarray, np.ndarray]:
        """Palette volume without air, in as few columns and planes as hold it, and its planes."""
        palette = self.volume.tissue_index
        return merge_planes(palette[:1, :1] if is_laterally_uniform(palette) else palette, self.volume.z_edges_mm)

    @cached_property
    def z_range(self) -> tuple[float, float]:
        """Highest and lowest z of the surface."""
        if self.relief is None:
            return 0.0, 0.0
        return float(self.relief[1][:, :, 0].min()), float(self.relief[1][:, :, 1].max())

    def tissue(self, band: int) -> Tissue:
        """The voxels of a band."""
        palette, z_edges = self.voxels
        mu_t = np.ascontiguousarray((self.volume.mu_a + self.volume.mu_s)[:, band])
        clearest = np.array([mu_t[np.unique(plane)].min() for plane in np.moveaxis(palette, 2, 0)])
        below = np.clip(z_edges, self.z_range[1], None)
        depth = np.concatenate([[0.0], np.cumsum(clearest * np.diff(below))])
        reached = int(np.searchsorted(depth, DEEPEST))
        deepest = np.inf
        if reached < len(depth):
            deepest = below[reached] - (depth[reached] - DEEPEST) / clearest[reached - 1]
        return Tissue(
            palette, np.ascontiguousarray(z_edges, np.float64), mu_t[:, None],
            np.ascontiguousarray(self.volume.g[:, band]), float(clearest.min()), float(deepest),
        )  # fmt: skip

    def connector(self, band: int, refine: int = REFINE) -> Callable[[int, int, np.ndarray], int]:
        """The function ``add(round, batch, image)`` that connects one round of a band."""
        lx, ly = map(float, self.volume.size_mm)
        index = np.ascontiguousarray(regions_of(self.volume).index[:-1, band])
        eta = float(index[0] / index[1])
        tissue = self.tissue(band)
        least = LEAST * self.film.per_mm_x * self.film.per_mm_y * eta * eta / (4.0 * np.pi)
        keep = roulette_table(self.photon_map, band)
        periodic = self.volume.sides == "periodic"
        box = footprint_mm(self.film, *self.z_range)
        if not periodic:
            box = np.concatenate([np.maximum(box[:2], 0.0), np.minimum(box[2:], [lx, ly])])
        if self.relief is None:
            borders = np.ascontiguousarray(regions_of(self.volume).border_z_mm[:-1], np.float64)
            kernel, special = deposit_flat, (box, _drift(self.film, index), borders, index)
        else:
            mesh = make_ray_mesh(self.film, self.relief[0], (lx, ly), eta, box, refine)
            kernel, special = deposit_relief, (mesh, *self.relief, eta)

        def add(round_index: int, batch: int, image: np.ndarray) -> int:
            part = self.photon_map.band_slice(round_index, band)
            return kernel(
                self.photon_map.position, self.photon_map.direction, part.start, part.stop, keep, lx, ly, periodic,
                tissue, self.film, *special, least, (round_index * self.photon_map.bands + band) << 32, image,
            )  # fmt: skip

        return add


def _drift(film: FilmPlane, index: np.ndarray) -> np.ndarray:
    """Bounds (low x, low y, high x, high y) of how far a view ray moves aside inside per mm of depth."""
    sine = np.hypot(film.axis[0], film.axis[1])
    if film.is_pinhole:
        half = 0.5 * np.hypot(film.columns / film.per_mm_x, film.rows / film.per_mm_y)
        sine = np.sin(min(np.arcsin(sine) + np.arctan(half / film.distance), 0.5 * np.pi))
    sines = np.minimum(index[0] * sine / index[1:], 1.0)
    slopes = sines / np.sqrt(np.maximum(1.0 - sines**2, 1e-6))
    if film.is_pinhole:
        return slopes.max() * np.array([-1.0, -1.0, 1.0, 1.0])
    aside = slopes[:, None] * film.axis[:2] / max(sine, 1e-30)
    return np.concatenate([aside.min(axis=0) - _SLACK, aside.max(axis=0) + _SLACK])


def estimate_reference(reference: Reference, bands: np.ndarray) -> BandsLight:
    """Reference estimate of the multiply scattered light in some bands (n,)."""
    photon_map, (columns, rows) = reference.photon_map, reference.camera.pixels
    pixels = rows * columns
    batches = batches_of(photon_map.rounds)
    radiance = np.zeros((rows, columns, len(bands)), np.float32)
    batch_y = np.zeros((len(batches), pixels), np.float32)
    totals, finer = np.zeros(len(batches)), np.zeros(len(batches))
    seen = 0

    def work(add: Callable, enter: Callable, which: list[np.ndarray]) -> tuple[np.ndarray, int]:
        return over_batches(reference.pool, which, add, enter, (pixels,))

    for k, band in enumerate(bands):
        power = photon_map.power_per_band[band]

        def enter(batch: int, image: np.ndarray, power=power, y=reference.y_weight[band]) -> None:
            totals[batch] += power * image.sum(dtype=np.float64)
            batch_y[batch] += image * np.float32(power * y)

        def enter_finer(batch: int, image: np.ndarray, power=power) -> None:
            finer[batch] += power * image.sum(dtype=np.float64)

        image, count = work(reference.connector(band), enter, batches)
        seen += count
        radiance[:, :, k] = (image * power).reshape(rows, columns)
        if reference.relief is not None:
            work(reference.connector(band, 2 * REFINE), enter_finer, batches[MESH_BATCHES])
        reference.progress(sum(_count(photon_map, index, band) for index in range(photon_map.rounds)))
        photon_map.forget_pages()
    return BandsLight(
        bands, radiance, None, batch_y.reshape(-1, rows, columns), totals, seen,
        batch_sum_finer=finer[: len(totals[MESH_BATCHES])]
    )


def remaining_bias(
    camera: Any, volume: SkinVolume, parts: Sequence[BandsLight], radiance: np.ndarray
) -> dict[str, tuple[float, float]]:
    """What may still be wrong with the mean of a reference (h, w, B), relative, by name: (value, standard error).

    "mesh": the mesh's result over that of one half as wide, less 1; "left_out": see `left_out`.
    """
    remaining = {"left_out": (_left_out(camera, volume, radiance), 0.0)}
    if volume.has_relief:
        coarse = np.sum([part.batch_sum[MESH_BATCHES] for part in parts], axis=0)
        remaining["mesh"] = _relative_change(coarse, np.sum([part.batch_sum_finer for part in parts], axis=0))
    return remaining


def _count(photon_map: PhotonMap, index: int, band: int) -> int:
    part = photon_map.band_slice(index, band)
    return part.stop - part.start


def _relative_change(ours: np.ndarray, finer: np.ndarray) -> tuple[float, float]:
    """ours / finer - 1 of the same batches of photons, with its standard error."""
    if not finer.any():
        return 0.0, np.inf
    change = (ours - finer) / finer.mean()
    spread = change.std(ddof=1) / np.sqrt(len(change)) if len(change) > 1 else np.inf
    return float(change.mean()), float(spread)


def _left_out(camera: Any, volume: SkinVolume, radiance: np.ndarray) -> float:
    """Share of the light that may be missing as view rays are not followed on, over all bands."""
    subpixels = max(1, round(np.sqrt(_VIEW_RAYS / np.prod(camera.pixels))))
    rays = view_rays(camera, volume.size_mm, subpixels)
    share = share_left_out(rays.origin, rays.direction, volume)
    weight = radiance.sum(axis=(0, 1), dtype=np.float64)
    return float(share @ weight / weight.sum()) if weight.any() else 0.0
