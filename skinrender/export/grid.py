"""Voxels of even height: other programs know no voxel layers of different heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.errors import InputError
from skinrender.skin.memory import require_memory
from skinrender.skin.spline import evaluate_grid
from skinrender.skin.volume import SkinVolume

_EVEN = 1e-6
"""Heights this close (relative) are even."""


@dataclass(frozen=True, eq=False)
class Labels:
    """Palette entries in even voxels.

    Attributes
    ----------
    entry : (nx, ny, nz) u2 palette entry of each voxel.
    spacing_mm : (3,) voxel edges.
    origin_mm : (3,) lower corner.
    """

    entry: np.ndarray
    spacing_mm: np.ndarray
    origin_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Means of one band's coefficients over even voxels.

    Attributes
    ----------
    mu_a, mu_s : (nx, ny, nz) f4, 1/mm.
    scatter_g : (nx, ny, nz) f4, mean of mu_s g, 1/mm.
    tissue : (nx, ny, nz) f4, share of the voxel that is not air; coefficients are means over that share.
    spacing_mm : (3,) voxel edges.
    """

    mu_a: np.ndarray
    mu_s: np.ndarray
    scatter_g: np.ndarray
    tissue: np.ndarray
    spacing_mm: np.ndarray


def band_index(volume: SkinVolume, band_nm: float) -> int:
    """Number of the band at a wavelength.

    Raises
    ------
    InputError : the volume has no such band.
    """
    near = int(np.argmin(np.abs(volume.wavelength_nm - band_nm)))
    if not abs(volume.wavelength_nm[near] - band_nm) <= 1e-3:  # also where it is not a number
        known = ", ".join(f"{nm:g}" for nm in volume.wavelength_nm)
        raise InputError(
            f"the scene has no band at {band_nm:g} nm", where="--band",
            remedy=f"choose one of {known}, or change `bands_nm`",
        )  # fmt: skip
    return near


def even_labels(volume: SkinVolume) -> Labels:
    """The volume in voxels of its finest height: each is what the voxel at its center is.

    The height is the finest one, made smaller by less than itself over the count so that whole voxels fill the depth.
    """
    edges = volume.z_edges_mm
    count = _even_count(edges)
    nx, ny, _ = volume.shape
    require_memory(
        2 * nx * ny * count, f"{nx} x {ny} x {count} voxels of even height", key=("patch", "columns"),
        remedy="use fewer columns, or layers that are not so unlike in thickness",
    )  # fmt: skip
    height = (edges[-1] - edges[0]) / count
    centers = edges[0] + (np.arange(count) + 0.5) * height
    layer = np.searchsorted(edges, centers, side="right") - 1
    spacing = np.array([volume.size_mm[0] / nx, volume.size_mm[1] / ny, height])
    return Labels(volume.palette_index[:, :, layer], spacing, np.array([0.0, 0.0, edges[0]]))


def flattened(volume: SkinVolume) -> tuple[np.ndarray, np.ndarray]:
    """Palette entries (nx, ny, nz) under a flat surface at z = 0, and their planes (nz + 1,) mm.

    A column under height s of the surface is shifted by s at its top, by 0 at its bottom and linearly between, so that its
    layers keep their order and, within |s| over the depth of the volume, their thickness.
    """
    if volume.surface_mm is None:
        return volume.palette_index, volume.z_edges_mm
    (nx, ny, _), edges = volume.shape, volume.z_edges_mm
    x, y = ((np.arange(count) + 0.5) * (length / count) for count, length in zip((nx, ny), volume.size_mm))
    surface = evaluate_grid(volume.surface_mm, volume.size_mm, x, y)
    planes = edges[np.searchsorted(edges, _EVEN * edges[-1]) :]
    planes = np.concatenate([[0.0], planes]) if planes[0] > 0.0 else planes
    center = 0.5 * (planes[1:] + planes[:-1])
    source = center + surface[..., None] * (1.0 - center / planes[-1])
    layer = np.clip(np.searchsorted(edges, source, side="right") - 1, 0, edges.size - 2)
    return np.take_along_axis(volume.tissue_index, layer, axis=2), planes


def mean_coefficients(
    volume: SkinVolume,
    index: np.ndarray,
    z_edges_mm: np.ndarray,
    band: int,
    columns: tuple[Sequence[int], Sequence[int]],
    z_cells_mm: np.ndarray,
    spacing_mm: np.ndarray,
) -> Coefficients:
    """Coefficients of one band, averaged over the depth of each cell, so that each column keeps its optical depth.

    Parameters
    ----------
    index, z_edges_mm : palette entries (nx, ny, nz) and their planes (nz + 1,).
    columns : which columns along x and y the result's columns are.
    z_cells_mm : (cells + 1,) planes of the result; what lies beyond the volume goes on as its last plane.
    """
    ix, iy = columns
    shape = (len(ix), len(iy), len(z_cells_mm) - 1)
    require_grid(shape)
    table = np.stack([
        volume.mu_a[:, band], volume.mu_s[:, band], volume.mu_s[:, band] * volume.g[:, band],
        (volume.palette_layer > 0).astype(float),
    ])  # fmt: skip
    means = np.zeros((4, *shape), np.float32)
    planes = np.array(z_edges_mm, float)
    planes[-1] = max(planes[-1], z_cells_mm[-1])
    for cell, (top, bottom) in enumerate(zip(z_cells_mm[:-1], z_cells_mm[1:])):
        overlap = np.minimum(planes[1:], bottom) - np.maximum(planes[:-1], top)
        met = np.flatnonzero(overlap > 0.0)
        share = overlap[met] / overlap[met].sum()
        for number, weight in zip(met, share):
            means[..., cell] += weight * table[:, index[:, :, number][np.ix_(ix, iy)]]
    tissue = means[3]
    filled = np.maximum(tissue, np.finfo(np.float32).tiny)
    return Coefficients(*(mean / filled for mean in means[:3]), tissue, np.asarray(spacing_mm, float))


def require_grid(shape: Sequence[float]) -> None:
    """Raise InputError where the coefficients of so many voxels are more than memory holds."""
    require_memory(
        20 * int(np.prod(shape, dtype=float)), "a grid of {:.4g} x {:.4g} x {:.4g} voxels".format(*shape),
        key=("patch", "columns"), remedy="use larger cubes (for mcx by --voxel-um), or fewer columns",
    )  # fmt: skip


def _even_count(edges: np.ndarray) -> int:
    """Least number of even voxels no higher than the finest of these."""
    return int(np.ceil((edges[-1] - edges[0]) / np.diff(edges).min() * (1.0 - _EVEN)))
