"""Scene -> voxel volume."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from skinrender.errors import InputError
from skinrender.optics.inks import ink_absorption, ink_names
from skinrender.optics.tables import spectrum_on_bands
from skinrender.scene import BUILD_PARTS, Scene, about, scene_hash, schema_lesion
from skinrender.skin.anatomy import LayerSpec, border_depths, skin_layers, slab_layers
from skinrender.skin.dermis import (
    center_of_layers,
    depth_of_layers_mm,
    range_of_layers_mm,
    require_in_dermis,
    voxel_layer_names,
)
from skinrender.skin.heights import Heights, scene_heights
from skinrender.skin.macule import DermalMacule
from skinrender.skin.memory import require_memory
from skinrender.skin.mole import Nests
from skinrender.skin.pattern import read_pattern
from skinrender.skin.spline import evaluate_grid
from skinrender.skin.stack import Palette, VoxelStack, voxel_stack
from skinrender.skin.tattoo import Tattoo
from skinrender.skin.volume import SkinVolume
from skinrender.sources import sources_hash

BUILD_SOURCES = ("optics", "skin")
PLANE_MM = 0.005
"""Height of the voxels where borders are not flat; half of the thinnest layer there where that is less."""
MOST_PLANES = 10_000
_BLOCK_VOXELS = 1 << 22


def build_volume(scene: Scene) -> SkinVolume:
    """The voxel volume that a scene describes.

    Parameters
    ----------
    scene : its skin or slab, patch, bands, relief, lesions, sides and media around it are read.

    Raises
    ------
    InputError : a pattern or height map is unusable, the relief is deeper than the layers, or the volume does not fit
        into memory (found before it is made).
    """
    with about(scene):
        return _built(scene)


def _built(scene: Scene) -> SkinVolume:
    layers = scene_layers(scene)
    columns = tuple(scene.patch.columns)
    _check_memory(columns, sum(layer.voxel_layers for layer in layers))
    stack = _darkened(scene, layers)
    palette, entry = stack.palette()
    heights = scene_heights(scene, layers)
    if heights is None:
        z_edges_mm, index = stack.depth_mm, entry[stack.column_class]
    else:
        z_edges_mm, index = _folded(stack, entry, heights, tuple(scene.patch.size_mm))
        palette = palette.kept(_drop_unused(index, palette.layer.size))
    inks = scene_inks(scene)
    return SkinVolume(
        palette_index=index,
        z_edges_mm=z_edges_mm,
        palette_layer=palette.layer,
        palette_melanin=palette.melanin,
        palette_ink=palette.ink if inks else None,
        ink_name=inks,
        layer_name=("air", *(layer.name for layer in layers)),
        size_mm=tuple(float(length) for length in scene.patch.size_mm),
        border_z_mm=border_depths([layer.thickness_mm for layer in layers]),
        sides=scene.sides,
        surface_mm=None if heights is None else heights.surface_mm,
        border_mm=None if heights is None else heights.borders_mm(layers),
        provenance=_provenance(scene),
        **_optics(scene, layers, palette, inks, flat=heights is None),
    )


def scene_layers(scene: Scene) -> tuple[LayerSpec, ...]:
    """The layers of a scene, top to bottom."""
    if scene.slab is not None:
        return slab_layers(scene.slab.layers)
    return skin_layers(scene.skin.site, scene.skin.layers, scene.skin.tone, scene.skin.pheomelanin)


def scene_inks(scene: Scene) -> tuple[str, ...]:
    """The inks of a scene's tattoos, in the order of their first use."""
    return tuple(dict.fromkeys(lesion.ink for lesion in scene.lesions if lesion.kind == "tattoo"))


def _ink_key(scene: Scene, ink: str) -> tuple[str | int, ...]:
    """Key of the first lesion's ink of that name."""
    first = next(i for i, lesion in enumerate(scene.lesions) if lesion.kind == "tattoo" and lesion.ink == ink)
    return "lesions", first, "ink"


def _darkened(scene: Scene, layers: Sequence[LayerSpec]) -> VoxelStack:
    columns, inks, names = tuple(scene.patch.columns), scene_inks(scene), voxel_layer_names(layers)
    epidermal, dermal, tattoos = [], [], []
    for i, lesion in enumerate(scene.lesions):
        scale = lesion.volume_fraction if lesion.kind == "tattoo" else lesion.melanin_scale
        with about(scene, "lesions", i, "pattern"):
            p = read_pattern(scene.path(lesion.pattern), columns, scale)
        with about(scene, "lesions", i):
            match lesion.kind:
                case "epidermal":
                    epidermal.append(p)
                case "dermal":
                    center_of_layers(names, lesion.center_layer)  # raises here, where the lesion's place is known
                    dermal.append(DermalMacule(p, lesion.center_layer, lesion.half_layers))
                case "mole":
                    epidermal.append(p)
                    dermal.append(Nests(p, _nest_depth_mm(lesion, layers), lesion.dermal_share))
                case "tattoo":
                    tattoos.append(Tattoo(p, inks.index(lesion.ink), _ink_depth_mm(lesion, layers)))
    return voxel_stack(layers, columns, epidermal, dermal, tattoos)


def _nest_depth_mm(mole: schema_lesion.Mole, layers: Sequence[LayerSpec]) -> float:
    if mole.depth_mm is None:
        return depth_of_layers_mm(layers, mole.depth_layers)
    require_in_dermis(mole.depth_mm, layers)
    return mole.depth_mm


def _ink_depth_mm(tattoo: schema_lesion.Tattoo, layers: Sequence[LayerSpec]) -> tuple[float, float]:
    if tattoo.depth_mm is None:
        return range_of_layers_mm(layers, tattoo.center_layer, tattoo.half_layers)
    require_in_dermis(tattoo.depth_mm[1], layers)
    return tattoo.depth_mm


def _optics(
    scene: Scene, layers: Sequence[LayerSpec], palette: Palette, inks: Sequence[str], flat: bool
) -> dict:
    """The coefficients and indices of a volume."""
    wavelength_nm = np.array(scene.wavelength_nm, float)
    mu_a, mu_s, g = np.zeros((3, palette.layer.size, wavelength_nm.size))
    n_outside = spectrum_on_bands(scene.outside.refractive_index, wavelength_nm, where="outside.refractive_index")
    n = [n_outside]
    for i, layer in enumerate(layers, 1):
        entries = palette.layer == i
        optics = layer.optics(wavelength_nm, palette.melanin[entries].astype(float))
        mu_a[entries], mu_s[entries], g[entries] = optics.mu_a, optics.mu_s, optics.g
        n.append(np.broadcast_to(optics.refractive_index, wavelength_nm.shape))
    for k, ink in enumerate(inks):
        known = ink in ink_names()
        with about(scene, *_ink_key(scene, ink)):
            mu_a += palette.ink[:, k, None] * ink_absorption(ink if known else scene.path(ink), wavelength_nm)
    below = scene.below.refractive_index
    n_below = n[-1] if below is None else spectrum_on_bands(below, wavelength_nm, where="below.refractive_index")
    fresnel = why_matched(scene, flat) is None
    return {
        "mu_a": mu_a, "mu_s": mu_s, "g": g, "refractive_index": np.stack(n), "wavelength_nm": wavelength_nm,
        "n_outside": n_outside, "n_below": np.array(n_below), "fresnel_borders": index_steps(n[1:]) if fresnel else (),
    }  # fmt: skip


def why_matched(scene: Scene, flat: bool) -> str | None:
    """Why no inner border reflects or refracts, whatever the indices; None where they do.

    flat: whether all borders of the volume are planes.
    """
    if scene.inner_borders != "auto":
        return None if scene.inner_borders == "fresnel" else "inner_borders is matched"
    if scene.slab is None:
        return "inner_borders is auto, which matches the layers of skin (their steps shift its color by 0.1 in L*a*b*)"
    return None if flat else "inner_borders is auto, which matches borders that are not flat"


def index_steps(refractive_index: Sequence[np.ndarray]) -> tuple[int, ...]:
    """Inner borders at which the indices (T, B) of the tissue layers step in any band."""
    return tuple(k for k, (a, b) in enumerate(itertools.pairwise(refractive_index)) if np.any(a != b))


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
    step_mm = min(PLANE_MM, 0.5 * _thinnest_mm(stack, below))
    if heights.fold.bottom_mm / step_mm > MOST_PLANES:
        raise InputError(
            f"a layer is {2000 * step_mm:.3g} um thin: voxels half as high would take "
            f"{heights.fold.bottom_mm / step_mm:.0f} planes, more than {MOST_PLANES}",
            where="relief", remedy=f"Make the layers of the epidermis {2200 * heights.fold.bottom_mm / MOST_PLANES:.2g} um "
            "thick or more, or use a flat relief and no border wave.",
        )  # fmt: skip
    planes = _planes(heights, float(border_mm.max()), step_mm)
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
    program = sources_hash(BUILD_SOURCES)
    return {"stage": "build", "hash": scene_hash(scene, BUILD_PARTS), "scene": described, "program": program}


def _check_memory(columns: tuple[int, int], voxel_layers: int, borders: int = 0) -> None:
    """Refuse a volume (u2 a voxel), or border heights (f8 a column), that memory cannot hold."""
    require_memory(
        columns[0] * columns[1] * (2 * voxel_layers + 8 * borders),
        f"a volume of {columns[0]} x {columns[1]} x {voxel_layers} voxels",
        key=("patch", "columns"),
        remedy="Use fewer columns or voxel layers.",
    )
