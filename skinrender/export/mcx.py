"""MCX input: one JSON file with media, source, boundaries and the label volume.

Keys as in the MCX manual (Q. Fang and D. Boas, Monte Carlo simulation of photon migration in 3D turbid media accelerated by
graphics processing units, Opt. Express 17, 2009; mcx.space). The volume is a JData array in ``Shapes``: its order of axes is
part of the format, while a ``.bin`` file is read x-fastest by `mcx` and z-fastest by `pmcx.json2mcx`. Lengths are in voxels
(cubes of ``LengthUnit`` mm), z down into the skin from the top of the grid.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import whole_file
from skinrender.export.grid import band_index, mean_coefficients, require_grid
from skinrender.export.media import Media, make_media
from skinrender.photonmap.light import CollimatedLight, Light, PointLight
from skinrender.skin.regions import Regions, regions_of
from skinrender.skin.volume import SkinVolume

MOST_CUBES = 2e7
"""Cubes of the default size are at most about this many."""
LONGEST_SECONDS = 5e-8
"""Time window: 10 m of path in tissue."""
PATTERN = 32
_GAP_VOXELS = 1e-3


@dataclass(frozen=True)
class McxFile:
    """What was written: the file, cubes (nx, ny, nz) of `edge_mm`, labels, their error, and what MCX does otherwise."""

    path: Path
    shape: tuple[int, ...]
    edge_mm: float
    labels: int
    label_error: float
    notes: tuple[str, ...]


def write_mcx(
    volume: SkinVolume, light: Light, band_nm: float, path: Path, *, edge_mm: float | None, photons: int, seed: int
) -> McxFile:
    """Write one band of a scene for MCX.

    Parameters
    ----------
    edge_mm : edge of the cubes, adjusted so that they fill the patch; None: the finest voxel height, as memory allows.
    photons, seed : of MCX's run.

    Raises
    ------
    InputError : no such band, or more cubes than memory holds.
    RunError : the file cannot be written.
    """
    band = band_index(volume, band_nm)
    edge = cube_edge(volume, edge_mm)
    regions = regions_of(volume)
    media = _media(volume, regions, band, edge)
    notes = _notes(volume, regions, band, edge, media)
    document = {
        "Session": _session(volume, regions, band, path.stem, photons, seed),
        "Forward": {"T0": 0.0, "T1": LONGEST_SECONDS, "Dt": LONGEST_SECONDS},
        "Optode": {"Source": _source(volume, regions, light, band, edge)},
        "Domain": _domain(media, edge, float(volume.n_outside[band])),
        "Shapes": _jdata(media.label),
        "skinrender": {
            "wavelength_nm": band_nm, "unit": "1/mm, mm", "label_error": media.error, "notes": notes,
            "provenance": volume.provenance,
        },
    }  # fmt: skip
    with whole_file(path) as partial:
        partial.write_text(json.dumps(document, indent=1), encoding="utf-8")
    return McxFile(path, media.label.shape, edge, len(media.mu_a), media.error, tuple(notes))


def cube_edge(volume: SkinVolume, wanted_mm: float | None = None) -> float:
    """Edge of cubes that fill the patch's width in whole numbers, and its length and depth as nearly as they can."""
    lengths = np.array([*volume.size_mm, volume.z_edges_mm[-1] - volume.z_edges_mm[0]])
    if wanted_mm is None:
        finest = min(
            np.diff(volume.z_edges_mm).min(), volume.size_mm[0] / volume.shape[0], volume.size_mm[1] / volume.shape[1]
        )
        wanted_mm = max(float(finest), float(np.prod(lengths) / MOST_CUBES) ** (1 / 3))
    require_grid(np.maximum(lengths / wanted_mm, 1.0))
    first = max(1, math.ceil(lengths[0] / wanted_mm * (1.0 - 1e-9)))
    counts = np.arange(first, max(first + 1, 4 * first if first < 50 else first + first // 8))
    cells = lengths[1:, None] / (lengths[0] / counts)
    misfit = np.abs(np.maximum(np.round(cells), 1.0) - cells).max(axis=0) / cells.min(axis=0)
    best = counts[int(np.argmax(misfit <= misfit.min() + 1e-9))]
    return float(lengths[0] / best)


def _media(volume: SkinVolume, regions: Regions, band: int, edge: float) -> Media:
    size, edges = volume.size_mm, volume.z_edges_mm
    shape = [max(1, round(length / edge)) for length in (*size, edges[-1] - edges[0])]
    columns = tuple(
        np.minimum(((np.arange(count) + 0.5) / count * voxels).astype(int), voxels - 1)
        for count, voxels in zip(shape[:2], volume.shape)
    )
    cells = edges[0] + edge * np.arange(shape[2] + 1)
    index = volume.palette_index
    means = mean_coefficients(volume, index, edges, band, columns, cells, np.full(3, edge))
    center = 0.5 * (cells[1:] + cells[:-1])
    region = np.clip(np.searchsorted(regions.border_z_mm, center, side="right") - 1, 0, regions.count - 1)
    n = regions.index[1:-1, band][region]
    return make_media(means.mu_a, means.mu_s, means.scatter_g, n, means.tissue > 0.5)


def _session(volume: SkinVolume, regions: Regions, band: int, name: str, photons: int, seed: int) -> dict[str, Any]:
    side = {"periodic": "c", "open": "a", "dielectric": "r"}[volume.sides]
    n = regions.index[:, band]
    bottom = "r" if _reflects_below(n) else "a"
    return {
        "ID": name, "Photons": photons, "RNGSeed": seed, "BCFlags": f"{side}{side}_{side}{side}{bottom}",
        "DoMismatch": int(np.any(n != n[0])), "DoSpecular": 1, "DoSaveVolume": 1, "DoNormalize": 1, "DoPartialPath": 0,
        "DoSaveRef": 0, "OutputType": "energy",
    }  # fmt: skip


def _reflects_below(n: np.ndarray) -> bool:
    """Whether the index below is nearer to the one outside, the only other that MCX knows, than to the last region's."""
    return abs(n[-1] - n[0]) < abs(n[-1] - n[-2])


def _domain(media: Media, edge: float, n_outside: float) -> dict[str, Any]:
    rows = [{"mua": 0.0, "mus": 0.0, "g": 1.0, "n": n_outside}]
    rows += [
        {"mua": float(a), "mus": float(s), "g": float(g), "n": float(n)}
        for a, s, g, n in zip(media.mu_a, media.mu_s, media.g, media.n)
    ]
    return {
        "Dim": list(media.label.shape), "OriginType": 1, "LengthUnit": edge,
        "MediaFormat": "byte" if media.label.dtype == np.uint8 else "short", "Media": rows,
    }  # fmt: skip


def _source(volume: SkinVolume, regions: Regions, light: Light, band: int, edge: float) -> dict[str, Any]:
    """The light where it enters: MCX refracts only what comes from outside, so then it starts just above the top."""
    width, length = (size / edge for size in volume.size_mm)
    height = -_GAP_VOXELS if regions.index[0, band] != regions.index[1, band] else 0.0
    area = {"Param1": [width, 0.0, 0.0, 0.0], "Param2": [0.0, length, 0.0, 0.0], "Pos": [0.0, 0.0, height]}
    if isinstance(light, PointLight):
        aim = np.array([0.5 * volume.size_mm[0], 0.5 * volume.size_mm[1], volume.z_edges_mm[0]]) - light.position_mm
        distance = float(np.linalg.norm(aim))
        area["Param1"][3] = area["Param2"][3] = float(PATTERN)
        weight = _irradiance_pattern(light, volume.size_mm)
        pattern = {"Nx": PATTERN, "Ny": PATTERN, "Nz": 1, "Data": [float(value) for value in weight.ravel()]}
        return {"Type": "pattern", "Dir": [*(aim / distance).tolist(), -distance / edge], **area, "Pattern": pattern}
    if not isinstance(light, CollimatedLight):
        return {"Type": "planar", "Dir": [0.0, 0.0, 1.0, "-_Inf_"], **area}  # a sky: Lambertian from every point
    direction = light.direction.tolist()
    if light.radius_mm is None:
        return {"Type": "planar", "Dir": [*direction, 0.0], **area}
    spot = np.array([*light.position_mm / edge, -float(volume.z_edges_mm[0]) / edge])
    rise = spot[2] - height
    if light.radius_mm > 0.0:  # an oblique disc reaches below its center
        rise += light.radius_mm / edge * math.hypot(*light.direction[:2])
    start = spot - light.direction * (rise / light.direction[2])
    if light.radius_mm == 0.0:
        return {"Type": "pencil", "Pos": start.tolist(), "Dir": [*direction, 0.0]}
    return {
        "Type": "disk",
        "Pos": start.tolist(),
        "Dir": [*direction, 0.0],
        "Param1": [light.radius_mm / edge, 0.0, 0.0, 0.0],
    }


def _irradiance_pattern(light: PointLight, size_mm: tuple[float, float]) -> np.ndarray:
    """Irradiance of the mean plane relative to its largest, (PATTERN, PATTERN) with rows along y."""
    x, y = ((np.arange(PATTERN) + 0.5) / PATTERN * size for size in size_mm)
    squared = (x - light.position_mm[0]) ** 2 + (y[:, None] - light.position_mm[1]) ** 2 + light.position_mm[2] ** 2
    weight = squared**-1.5
    return weight / weight.max()


def _jdata(label: np.ndarray) -> dict[str, Any]:
    packed = zlib.compress(np.ascontiguousarray(label, label.dtype.newbyteorder("<")).data, 6)
    return {
        "_ArrayType_": label.dtype.name, "_ArraySize_": list(label.shape), "_ArrayOrder_": "r", "_ArrayZipType_": "zlib",
        "_ArrayZipSize_": label.size, "_ArrayZipData_": base64.b64encode(packed).decode(),
    }  # fmt: skip


def _notes(volume: SkinVolume, regions: Regions, band: int, edge: float, media: Media) -> list[str]:
    lengths = np.array([*volume.size_mm, volume.z_edges_mm[-1] - volume.z_edges_mm[0]])
    misfit = np.array(media.label.shape) * edge - lengths
    notes = []
    if np.abs(misfit).max() > 1e-6 * edge:
        told = ", ".join(f"{value:+.3g}" for value in misfit)
        notes.append(f"cubes of {edge:.6g} mm do not fill the volume: its extent differs by {told} mm")
    if media.error > 1e-5:
        notes.append(
            f"voxels share {len(media.mu_a)} labels: mu_a or mu_s of a voxel is off by at most {100 * media.error:.2g} %"
        )
    if volume.has_relief:
        notes.append(
            "the relief is in steps of cubes; MCX reflects and refracts at their faces, not at the surface's slope"
        )
    n = regions.index[:, band]
    below = n[0] if _reflects_below(n) else n[-2]
    if below != n[-1]:
        notes.append(
            f"below the volume the index is {below:.4g}, not {n[-1]:.4g}: MCX knows that of the tissue or that outside"
        )
    if volume.border_mm is not None and regions.count > 1:
        notes.append("borders at which the index steps are flat")
    return notes
