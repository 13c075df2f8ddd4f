"""Scene -> voxel volume."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from skinrender.optics.tables import spectrum_on_bands
from skinrender.scene import BUILD_PARTS, Scene, scene_hash
from skinrender.skin.anatomy import LayerSpec, border_depths, skin_layers, slab_layers
from skinrender.skin.heights import Heights, scene_heights
from skinrender.skin.memory import require_memory
from skinrender.skin.pattern import read_pattern
from skinrender.skin.spline import evaluate_grid
from skinrender.skin.stack import DermalMacule, VoxelStack, voxel_stack
from skinrender.skin.volume import SkinVolume

PLANE_MM = 0.005
"""Height of the voxels where borders are not flat; half of the thinnest layer there where that is less."""
_BLOCK_VOXELS = 1 << 22


def build_volume(scene: Scene) -> SkinVolume:
    """The voxel volume that a scene describes.

    Raises
    ------
    InputError : a pattern or height map is unusable, the relief is deeper than the layers, or the volume does not fit
        into memory (found before it is made).
    """
    layers = scene_layers(scene)
    columns = tuple(scene.patch.columns)
    _check_memory(columns, sum(layer.voxel_layers for layer in layers))
    stack = _darkened(scene, layers)
    palette_layer, palette_melanin, entry = stack.palette()
    heights = scene_heights(scene, layers)
    if heights is None:
        z_edges_mm, index = stack.depth_mm, entry[stack.column_class]
    else:
        z_edges_mm, index = _folded(stack, entry, heights, tuple(scene.patch.size_mm))
        used = _drop_unused(index, palette_layer.size)
        palette_layer, palette_melanin = palette_layer[used], palette_melanin[used]
    return SkinVolume(
        palette_index=index,
        z_edges_mm=z_edges_mm,
        palette_layer=palette_layer,
        palette_melanin=palette_melanin,
        layer_name=("air", *(layer.name for layer in layers)),
        size_mm=tuple(float(length) for length in scene.patch.size_mm),
        border_z_mm=border_depths([layer.thickness_mm for layer in layers]),
        sides=scene.sides,
        surface_mm=None if heights is None else heights.surface_mm,
        border_mm=None if heights is None else heights.borders_mm(layers),
        provenance=_provenance(scene),
        **_optics(scene, layers, palette_layer, palette_melanin, flat=heights is None),
    )


def scene_layers(scene: Scene) -> tuple[LayerSpec, ...]:
    """The layers of a scene, top to bottom."""
    if scene.slab is not None:
        return slab_layers(scene.slab.layers)
    return skin_layers(scene.skin.site, scene.skin.layers)


def _darkened(scene: Scene, layers: Sequence[LayerSpec]) -> VoxelStack:
    columns = tuple(scene.patch.columns)
    epidermal, dermal = [], []
    for lesion in scene.lesions:
        p = read_pattern(scene.path(lesion.pattern), columns, lesion.melanin_scale)
        if lesion.kind == "epidermal":
            epidermal.append(p)
        else:
            dermal.append(DermalMacule(p, lesion.center_layer, lesion.half_layers))
    return voxel_stack(layers, columns, epidermal, dermal)


def _optics(
    scene: Scene, layers: Sequence[LayerSpec], palette_layer: np.ndarray, palette_melanin: np.ndarray, flat: bool
) -> dict:
    """The coefficients and indices of a volume."""
    wavelength_nm = np.array(scene.wavelength_nm, float)
    mu_a, mu_s, g = np.zeros((3, palette_layer.size, wavelength_nm.size))
    n_outside = spectrum_on_bands(scene.outside.refractive_index, wavelength_nm, where="outside.refractive_index")
    n = [n_outside]
    for i, layer in enumerate(layers, 1):
        entries = palette_layer == i
        optics = layer.optics(wavelength_nm, palette_melanin[entries].astype(float))
        mu_a[entries], mu_s[entries], g[entries] = optics.mu_a, optics.mu_s, optics.g
        n.append(np.broadcast_to(optics.refractive_index, wavelength_nm.shape))
    below = scene.below.refractive_index
    n_below = n[-1] if below is None else spectrum_on_bands(below, wavelength_nm, where="below.refractive_index")
    fresnel = scene.inner_borders == "fresnel" or (scene.inner_borders == "auto" and flat and scene.slab is not None)
    steps = [k for k, (a, b) in enumerate(itertools.pairwise(n[1:])) if np.any(a != b)]
    return {
        "mu_a": mu_a, "mu_s": mu_s, "g": g, "refractive_index": np.stack(n), "wavelength_nm": wavelength_nm,
        "n_outside": n_outside, "n_below": np.array(n_below), "fresnel_borders": tuple(steps) if fresnel else (),
    }  # fmt: skip


def _folded(
    stack: VoxelStack, entry: np.ndarray, heights: Heights, size_mm: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """z_edges_mm and palette_index under relief and wave: each voxel is what its center is.

    Planes are fine from the highest ridge down to the last change of content that is not flat; what is left of the
    fold is one voxel layer, and below it the voxel layers are those of the stack.
    """
    x, y = ((np.arange(count) + 0.5) * (length / count) for count, length in zip(stack.column_class.shape, size_mm))
    depth = stack.depth_mm
    below = int(np.searchsorted(depth, heights.fold.bottom_mm - 1e-9))
    changes = [0, *(k for k in range(1, below) if np.any(entry[:, k] != entry[:, k - 1]))]
    _check_memory(stack.column_class.shape, 0, len(changes))
    border_mm = np.stack([evaluate_grid(heights.at(depth[k]), size_mm, x, y) for k in changes])
    planes = _planes(heights, float(border_mm.max()), min(PLANE_MM, 0.5 * _thinnest_mm(stack, below)))
    content = np.concatenate([np.zeros((len(entry), 1), np.uint16), entry[:, changes]], axis=1)
    whole = planes[-1] > depth[below] - 1e-9
    lower = entry[:, below:] if whole else entry[:, below - 1 :]
    z_edges_mm = np.concatenate([planes, depth[below + 1 :] if whole else depth[below:]])
    return z_edges_mm, _sampled(planes, border_mm, content, lower, stack.column_class)


def _thinnest_mm(stack: VoxelStack, below: int) -> float:
    """Thickness of the thinnest layer above voxel layer ``below``."""
    layer = stack.layer[:below]
    return min(float(stack.height_mm[:below][layer == i].sum()) for i in np.unique(layer))


def _planes(heights: Heights, last_mm: float, step_mm: float) -> np.ndarray:
    """Evenly spaced planes, one of them z = 0 and one the bottom of the fold, that enclose the surface and last_mm."""
    bottom_mm = heights.fold.bottom_mm
    count = int(np.ceil(bottom_mm / step_mm - 1e-6))
    top_mm = 0.0 if heights.surface_mm is None else float(heights.surface_mm.min())
    first = int(np.floor(top_mm * count / bottom_mm))
    last = min(count, int(np.ceil(last_mm * count / bottom_mm)))
    return bottom_mm * np.arange(first, last + 1) / count


def _sampled(
    planes: np.ndarray, border_mm: np.ndarray, content: np.ndarray, lower: np.ndarray, column_class: np.ndarray
) -> np.ndarray:
    """Palette indices (nx, ny, nz): content[c, k] below k borders (K, nx, ny) of fine planes, then ``lower``."""
    nx, ny = column_class.shape
    centers = 0.5 * (planes[1:] + planes[:-1])
    _check_memory((nx, ny), centers.size + lower.shape[1])
    index = np.empty((nx, ny, centers.size + lower.shape[1]), np.uint16)
    rows = max(1, _BLOCK_VOXELS // (ny * centers.size))
    for start in range(0, nx, rows):
        block = slice(start, start + rows)
        passed = np.zeros((*column_class[block].shape, centers.size), np.uint16)
        for border in border_mm[:, block]:
            passed += centers >= border[..., None]
        index[block, :, : centers.size] = content[column_class[block, :, None], passed]
        index[block, :, centers.size :] = lower[column_class[block]]
    return index


def _drop_unused(index: np.ndarray, palette_size: int) -> np.ndarray:
    """Renumber voxels, in place, to the palette entries (P,) bool that a plane or column met, air among them."""
    used = np.zeros(palette_size, bool)
    used[0] = True
    for plane in index:
        used[plane] = True
    if not used.all():
        number = (np.cumsum(used) - 1).astype(np.uint16)
        for plane in index:
            plane[...] = number[plane]
    return used


def _provenance(scene: Scene) -> dict:
    described = scene.model_dump(mode="json", include=set(BUILD_PARTS), exclude_none=True)
    return {"stage": "build", "hash": scene_hash(scene, BUILD_PARTS), "scene": described}


def _check_memory(columns: tuple[int, int], voxel_layers: int, borders: int = 0) -> None:
    require_memory(
        columns[0] * columns[1] * (2 * voxel_layers + 8 * borders),
        f"a volume of {columns[0]} x {columns[1]} x {voxel_layers} voxels",
        where="patch.columns",
        remedy="Use fewer columns or voxel layers.",
    )
