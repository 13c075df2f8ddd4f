"""The voxel layers of a scene before they are folded: columns of equal content share one class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.errors import SceneError
from skinrender.skin.anatomy import LayerSpec, border_depths
from skinrender.skin.macule import DermalMacule, darken_epidermis, merge_below
from skinrender.skin.mole import Nests
from skinrender.skin.tattoo import Tattoo, add_ink

MAX_PALETTE = 1 << 16


@dataclass(frozen=True, eq=False)
class Palette:
    """Contents of voxels, no two alike; entry 0 is air. layer (P,) u1, melanin (P,) f4, ink (P, I) f4."""

    layer: np.ndarray
    melanin: np.ndarray
    ink: np.ndarray

    def kept(self, used: np.ndarray) -> Palette:
        """The entries (P,) bool that are used."""
        return Palette(self.layer[used], self.melanin[used], self.ink[used])


@dataclass(frozen=True, eq=False)
class VoxelStack:
    """Voxel layers, top to bottom, of C classes of columns.

    Parameters
    ----------
    layer (S,) : tissue layer of each voxel layer, from 0.
    height_mm (S,) : their heights.
    melanin (C, S) f4 : melanosome fraction.
    ink (C, S, I) f4 : volume fraction of each ink; I = 0 without tattoos.
    column_class (nx, ny) : class of each column.
    """

    layer: np.ndarray
    height_mm: np.ndarray
    melanin: np.ndarray
    ink: np.ndarray
    column_class: np.ndarray

    @property
    def depth_mm(self) -> np.ndarray:
        """Depths (S + 1,) of the voxel layers' borders."""
        return border_depths(self.height_mm)

    def palette(self) -> tuple[Palette, np.ndarray]:
        """The distinct contents, air first, and the palette entry (C, S) u2 of each voxel."""
        contents = [np.broadcast_to(self.layer + 1, self.melanin.shape), self.melanin, *np.moveaxis(self.ink, -1, 0)]
        contents = [content.reshape(-1) for content in contents]
        code = _coded(contents)
        used, first = np.unique(code, return_index=True)
        if used.size >= MAX_PALETTE:
            raise SceneError(
                f"the lesions make {used.size} different contents of voxels, more than {MAX_PALETTE - 1}",
                key=("lesions",),
                remedy="Use fewer lesions over each other, or patterns of fewer gray levels.",
            )
        layer, melanin, *ink = (np.concatenate([[0], content[first]]) for content in contents)
        columns = np.stack(ink, axis=1) if ink else np.zeros((layer.size, 0))
        palette = Palette(layer.astype(np.uint8), melanin.astype(np.float32), columns.astype(np.float32))
        return palette, (code.reshape(self.melanin.shape) + 1).astype(np.uint16)


def voxel_stack(
    layers: Sequence[LayerSpec], columns: tuple[int, int], epidermal: Sequence[np.ndarray] = (),
    dermal: Sequence[DermalMacule | Nests] = (), tattoos: Sequence[Tattoo] = (),
) -> VoxelStack:  # fmt: skip
    """Divide layers into voxel layers and darken them by lesions.

    Parameters
    ----------
    columns : (nx, ny).
    epidermal : pattern values (nx, ny); where macules overlap these add up.
    dermal : dermal macules and nests of moles, each added to what is there.
    tattoos : each adds its ink to what is there.
    """
    counts = [spec.voxel_layers for spec in layers]
    layer = np.repeat(np.arange(len(layers)), counts)
    height_mm = np.repeat([spec.thickness_mm / spec.voxel_layers for spec in layers], counts)
    names = [layers[i].name for i in layer]
    fields = ([sum(epidermal)] if epidermal else []) + [lesion.p for lesion in (*dermal, *tattoos)]
    column_class, values = _classes(fields, columns)
    melanin = np.tile([layers[i].tissue.melanosome for i in layer], (len(values), 1))
    ink = np.zeros((*melanin.shape, 1 + max((tattoo.ink for tattoo in tattoos), default=-1)))
    each, lowest = iter(values.T), [-1]
    if epidermal:
        melanin = darken_epidermis(melanin, names, next(each))
    for lesion in dermal:
        melanin, changed = lesion.darken(melanin, names, height_mm, next(each))
        lowest.append(changed)
    for tattoo in tattoos:
        ink[..., tattoo.ink], changed = add_ink(ink[..., tattoo.ink], names, height_mm, next(each), tattoo.depth_mm)
        lowest.append(changed)
    if max(lowest) >= 0:
        first, height_mm = merge_below(layer, height_mm, max(lowest))
        layer, melanin, ink = layer[first], melanin[:, first], ink[:, first]
    return VoxelStack(layer, height_mm, melanin.astype(np.float32), ink.astype(np.float32), column_class)


def _classes(fields: Sequence[np.ndarray], columns: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Class of each column (nx, ny), and the value of each field in each class (C, fields)."""
    if not fields:
        return np.zeros(columns, np.int64), np.zeros((1, 0))
    code = _coded(fields).reshape(columns)
    _, first = np.unique(code, return_index=True)
    return code, np.stack([field.reshape(-1)[first] for field in fields], axis=1)


def _coded(fields: Sequence[np.ndarray]) -> np.ndarray:
    """Number (N,) of the combination of values in fields of N entries each, in the order of the values, from 0."""
    code = np.zeros(fields[0].size, np.int64)
    for field in fields:
        levels, level = np.unique(field, return_inverse=True)
        _, code = np.unique(code * levels.size + level.reshape(-1), return_inverse=True)
    return code
