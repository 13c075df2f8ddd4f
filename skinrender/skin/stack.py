"""The voxel layers of a scene before they are folded: columns of equal content share one class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.errors import InputError
from skinrender.skin.anatomy import LayerSpec, border_depths
from skinrender.skin.macule import darken_dermis, darken_epidermis, merge_below

MAX_PALETTE = 1 << 16


@dataclass(frozen=True, eq=False)
class DermalMacule:
    """A dermal lesion with its pattern read.

    Parameters
    ----------
    p (nx, ny) : pattern values.
    center_layer, half_layers : see :func:`skinrender.skin.macule.darken_dermis`.
    """

    p: np.ndarray
    center_layer: int
    half_layers: int


@dataclass(frozen=True, eq=False)
class VoxelStack:
    """Voxel layers, top to bottom, of C classes of columns.

    Parameters
    ----------
    layer (S,) : tissue layer of each voxel layer, from 0.
    height_mm (S,) : their heights.
    melanin (C, S) f4 : melanosome fraction.
    column_class (nx, ny) : class of each column.
    """

    layer: np.ndarray
    height_mm: np.ndarray
    melanin: np.ndarray
    column_class: np.ndarray

    @property
    def depth_mm(self) -> np.ndarray:
        """Depths (S + 1,) of the voxel layers' borders."""
        return border_depths(self.height_mm)

    def palette(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distinct contents, air first: palette_layer (P,) u1 (0 = air), palette_melanin (P,) f4, entry (C, S) u2."""
        layer = np.broadcast_to(self.layer + 1, self.melanin.shape)
        key = layer.astype(np.uint64) << np.uint64(32) | self.melanin.view(np.uint32)
        used, entry = np.unique(key, return_inverse=True)
        if used.size >= MAX_PALETTE:
            raise InputError(
                f"the lesions make {used.size} different contents of voxels, more than {MAX_PALETTE - 1}",
                where="lesions",
                remedy="Use fewer lesions over each other, or patterns of fewer gray levels.",
            )
        palette_layer = np.concatenate([[0], used >> np.uint64(32)]).astype(np.uint8)
        melanin_bits = (used & np.uint64(0xFFFFFFFF)).astype(np.uint32)
        palette_melanin = np.concatenate([np.zeros(1, np.float32), melanin_bits.view(np.float32)])
        return palette_layer, palette_melanin, (entry.reshape(self.melanin.shape) + 1).astype(np.uint16)


def voxel_stack(
    layers: Sequence[LayerSpec], columns: tuple[int, int], epidermal: Sequence[np.ndarray] = (),
    dermal: Sequence[DermalMacule] = (),
) -> VoxelStack:  # fmt: skip
    """Divide layers into voxel layers and darken them by lesions.

    Parameters
    ----------
    columns : (nx, ny).
    epidermal : pattern values (nx, ny); where macules overlap these add up.
    dermal : dermal macules, each added to what is there.
    """
    counts = [spec.voxel_layers for spec in layers]
    layer = np.repeat(np.arange(len(layers)), counts)
    height_mm = np.repeat([spec.thickness_mm / spec.voxel_layers for spec in layers], counts)
    names = [layers[i].name for i in layer]
    fields = ([sum(epidermal)] if epidermal else []) + [macule.p for macule in dermal]
    column_class, values = _classes(fields, columns)
    melanin = np.tile([layers[i].tissue.melanosome for i in layer], (len(values), 1))
    lowest = -1
    if epidermal:
        melanin = darken_epidermis(melanin, names, values[:, 0])
    for macule, p in zip(dermal, values.T[-len(dermal) :] if dermal else ()):
        melanin, changed = darken_dermis(melanin, names, p, macule.center_layer, macule.half_layers)
        lowest = max(lowest, changed)
    if lowest >= 0:
        first, height_mm = merge_below(layer, height_mm, lowest)
        layer, melanin = layer[first], melanin[:, first]
    return VoxelStack(layer, height_mm, np.ascontiguousarray(melanin, np.float32), column_class)


def _classes(fields: Sequence[np.ndarray], columns: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Class of each column (nx, ny), and the value of each field in each class (C, fields)."""
    code = np.zeros(columns, np.int64)
    for field in fields:
        levels, level = np.unique(field, return_inverse=True)
        _, code = np.unique(code * levels.size + level.reshape(columns), return_inverse=True)
    code = code.reshape(columns)
    _, first = np.unique(code, return_index=True)
    return code, np.stack([f.reshape(-1)[first] for f in fields], axis=1) if fields else np.zeros((1, 0))
