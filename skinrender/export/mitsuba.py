"""A Mitsuba 3 scene of one band: the medium on a grid, the light, the camera and the borders that refract.

Mitsuba's world is the program's own: mm, z down into the skin, the patch from (0, 0) to its size. With lengths in mm and
intensities in W/sr its picture is radiance in the band, W mm^-2 sr^-1 (W. Jakob et al., Mitsuba 3 renderer, 2022).

The skin is a block in a black tub: light enters through the top alone, and what leaves through a side is lost.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import whole_file
from skinrender.export.grid import Coefficients, band_index, flattened, mean_coefficients
from skinrender.export.mitsuba_view import add_light, add_sensor
from skinrender.export.vol import write_vol
from skinrender.export.xml import add, add_matrix, add_number
from skinrender.photonmap.light import Light
from skinrender.skin.regions import Regions, regions_of
from skinrender.skin.volume import SkinVolume

MOST_VOXELS = 2e7
"""Voxels are made higher until there are about this many."""
_GAP = 1e-3
"""Between block and tub, relative to the block's smallest extent."""
_SAME = 1e-6
_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True)
class MitsubaFiles:
    """What was written: the scene, its grids, and what Mitsuba does otherwise."""

    scene: Path
    grids: tuple[Path, ...]
    notes: tuple[str, ...]


def write_mitsuba(
    volume: SkinVolume, light: Light, camera: Any, band_nm: float, path: Path, samples: int
) -> MitsubaFiles:
    """Write one band of a scene for Mitsuba 3, which renders the file as it is.

    Parameters
    ----------
    light, camera : of the scene.
    path : the XML; grids go beside it.
    samples : paths a pixel.

    Raises
    ------
    InputError : no such band, or a light or camera that Mitsuba has not; the message says what to change.
    RunError : a file cannot be written.
    """
    band, regions = band_index(volume, band_nm), regions_of(volume)
    n = regions.index[:, band]
    view = ET.Element("view")
    notes = [*_notes(volume, n), *add_light(view, light, band, bool(n[0] != n[1]))]
    add_sensor(view, camera, volume.size_mm)
    medium = _medium_on_grid(volume, band)
    notes += _phase_notes(volume, band)
    extent = np.array([*volume.size_mm, volume.z_edges_mm[-1]])
    root = ET.Element("scene", version="3.0.0")
    root.append(ET.Comment(_comment(band_nm, notes)))
    add(root, "default", name="spp", value=str(samples))
    _add_integrator(root)
    grids = _add_medium(root, medium, volume, band, path, extent)
    root.extend(view)
    _add_block(root, extent, regions, n, n[1] if volume.sides == "dielectric" else n[0])
    _add_tub(root, extent)
    ET.indent(root)
    with whole_file(path) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    return MitsubaFiles(path, tuple(grids), tuple(notes))


def _medium_on_grid(volume: SkinVolume, band: int) -> Coefficients:
    """The band under a flat surface; one column where all are alike."""
    index, planes = flattened(volume)
    if np.all(index == index[:1, :1]):
        index = index[:1, :1]
    nx, ny, _ = index.shape
    count = int(np.ceil(planes[-1] / np.diff(planes).min() * (1.0 - _SAME)))
    count = max(1, min(count, int(MOST_VOXELS / (nx * ny))))
    spacing = np.array([volume.size_mm[0] / nx, volume.size_mm[1] / ny, planes[-1] / count])
    cells = np.linspace(0.0, planes[-1], count + 1)
    return mean_coefficients(volume, index, planes, band, (np.arange(nx), np.arange(ny)), cells, spacing)


def _add_integrator(root: ET.Element) -> None:
    integrator = add(root, "integrator", type="volpath")
    add_number(integrator, "max_depth", -1, "integer")
    add_number(integrator, "rr_depth", 1_000_000, "integer")  # roulette by albedo ruins media that hardly absorb
    add(integrator, "boolean", name="hide_emitters", value="true")


def _add_medium(
    root: ET.Element, medium: Coefficients, volume: SkinVolume, band: int, path: Path, extent: np.ndarray
) -> list[Path]:
    """The medium, and its grids beside the scene; what is the same everywhere is a number."""
    sigma_t = medium.mu_a + medium.mu_s
    grids = {"sigma_t": sigma_t, "albedo": _ratio(medium.mu_s, sigma_t)}
    values = _g_values(volume, band)
    if len(values) > 1:
        g = _ratio(medium.scatter_g, medium.mu_s)
        grids["weight"] = np.clip((g - values[0]) / (values[-1] - values[0]), 0.0, 1.0)
    uniform = all(_is_uniform(grids[name]) for name in ("sigma_t", "albedo"))
    node = add(root, "medium", type="homogeneous" if uniform else "heterogeneous", id="tissue")
    written = [_add_grid(node, name, grids[name], path, extent) for name in ("sigma_t", "albedo")]
    if len(values) == 1:
        _add_phase(node, values[0])
    else:
        blend = add(node, "phase", type="blendphase")
        written.append(_add_grid(blend, "weight", grids["weight"], path, extent))
        _add_phase(blend, values[0])
        _add_phase(blend, values[-1])
    return [grid for grid in written if grid is not None]


def _add_grid(node: ET.Element, name: str, values: np.ndarray, path: Path, extent: np.ndarray) -> Path | None:
    if _is_uniform(values):
        add_number(node, name, float(values.ravel()[0]))
        return None
    file = path.with_name(f"{path.stem}_{name}.vol")
    write_vol(file, values)
    grid = add(node, "volume", type="gridvolume", name=name)
    add(grid, "string", name="filename", value=file.name)
    add(grid, "string", name="filter_type", value="nearest")
    add(grid, "boolean", name="raw", value="true")
    add_matrix(grid, (extent[0] * _X, extent[1] * _Y, extent[2] * _Z), (0.0, 0.0, 0.0))
    return file


def _add_phase(node: ET.Element, g: float) -> None:
    add_number(add(node, "phase", type="hg"), "g", g)


def _add_block(root: ET.Element, extent: np.ndarray, regions: Regions, n: np.ndarray, n_at_sides: float) -> None:
    """Borders from the surface down, and the sides; each border's rectangle looks up, so that its inside is below it."""
    last = regions.count
    for k, z in enumerate((0.0, *regions.border_z_mm[1:-1], extent[2])):
        at = (0.5 * extent[0], 0.5 * extent[1], z)
        face = _add_rectangle(root, 0.5 * extent[0] * _X, -0.5 * extent[1] * _Y, -_Z, at)
        media = {"exterior": k > 0, "interior": k < last}
        _add_interface(face, n[k + 1], n[k], [name for name, inside in media.items() if inside])
    for face in _add_walls(root, extent, 0.0):
        _add_interface(face, n_at_sides, n[0], ["interior"])


def _add_interface(face: ET.Element, n_inside: float, n_outside: float, media: Sequence[str]) -> None:
    if n_inside == n_outside:
        add(face, "bsdf", type="null")
    else:
        dielectric = add(face, "bsdf", type="dielectric")
        add_number(dielectric, "int_ior", n_inside)
        add_number(dielectric, "ext_ior", n_outside)
    for name in media:
        add(face, "ref", name=name, id="tissue")


def _add_tub(root: ET.Element, extent: np.ndarray) -> None:
    gap = _GAP * float(extent.min())
    floor = (0.5 * extent[0], 0.5 * extent[1], extent[2] + gap)
    across = 0.5 * extent + gap
    walls = [*_add_walls(root, extent, gap), _add_rectangle(root, across[0] * _X, across[1] * _Y, _Z, floor)]
    for wall in walls:
        black = add(add(wall, "bsdf", type="twosided"), "bsdf", type="diffuse")
        add(black, "spectrum", name="reflectance", value="0")


def _add_walls(root: ET.Element, extent: np.ndarray, gap: float) -> list[ET.Element]:
    """Four upright rectangles that look outwards, `gap` off the block's sides."""
    walls = []
    half = 0.5 * extent
    for axis, other in ((0, 1), (1, 0)):
        for sign in (-1.0, 1.0):
            normal = sign * np.eye(3)[axis]
            along = np.eye(3)[other] * (half[other] + gap)
            down = np.cross(normal, np.eye(3)[other]) * (half[2] + 0.5 * gap)
            center = np.array([half[0], half[1], half[2] + 0.5 * gap])
            center[axis] += sign * (half[axis] + gap)
            walls.append(_add_rectangle(root, along, down, normal, center))
    return walls


def _add_rectangle(
    root: ET.Element, u: np.ndarray, v: np.ndarray, normal: np.ndarray, center: Sequence[float]
) -> ET.Element:
    shape = add(root, "shape", type="rectangle")
    add_matrix(shape, (u, v, normal), center)
    return shape


def _g_values(volume: SkinVolume, band: int) -> np.ndarray:
    """Anisotropies of the tissue that scatters, ascending; [0] where none does."""
    scatters = volume.mu_s[:, band] > 0.0
    values = np.unique(np.round(volume.g[scatters, band], 9))
    return values if values.size else np.zeros(1)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.zeros_like(whole), where=whole > 0.0)


def _is_uniform(values: np.ndarray) -> bool:
    return float(values.max() - values.min()) <= _SAME * float(abs(values).max())


def _notes(volume: SkinVolume, n: np.ndarray) -> list[str]:
    notes = []
    if volume.sides == "periodic":
        notes.append(
            "periodic sides are not representable: the block's sides are open, what leaves through them is lost"
        )
    if volume.sides == "dielectric" and len(n) > 3:
        notes.append("the block's sides reflect as those of its uppermost layer")
    if volume.has_relief:
        notes.append("the relief is left out: the surface is its mean plane, and columns are shifted under it")
    if n[0] != n[1]:
        notes.append("the surface is smooth, and what it reflects is in the picture")
    if volume.border_mm is not None and len(n) > 3:
        notes.append("inner borders that refract are planes")
    return notes


def _phase_notes(volume: SkinVolume, band: int) -> list[str]:
    values = _g_values(volume, band)
    if len(values) <= 2:
        return []
    return [f"{len(values)} values of g are mixtures of the lowest and the highest, of the same mean cosine"]


def _comment(band_nm: float, notes: Sequence[str]) -> str:
    told = [f"{band_nm:g} nm", "lengths in mm, radiance in W mm^-2 sr^-1 in the band", *notes]
    return " " + "; ".join(told).replace("--", "-") + " "
