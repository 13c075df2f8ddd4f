"""Depths in the dermis, where moles and tattoos lie: in mm below its top, or in voxel layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinrender.errors import InputError
from skinrender.skin.anatomy import DERMIS, LayerSpec, border_depths


def dermis_mm(layers: Sequence[LayerSpec]) -> tuple[float, float]:
    """Depths of the top and the bottom of the dermis below the surface."""
    top_mm = sum(layer.thickness_mm for layer in layers[: next(i for i, at in enumerate(layers) if at.name in DERMIS)])
    return top_mm, top_mm + float(_borders_mm(layers)[-1])


def depth_of_layers_mm(layers: Sequence[LayerSpec], voxel_layers: int) -> float:
    """Height of the uppermost voxel layers of the dermis; InputError where it has fewer."""
    border_mm = _borders_mm(layers)
    if voxel_layers >= border_mm.size:
        raise InputError(
            f"{voxel_layers} voxel layers reach below the dermis", where="lesions", remedy=f"Use 1 to {border_mm.size - 1}."
        )
    return float(border_mm[voxel_layers])


def range_of_layers_mm(layers: Sequence[LayerSpec], center_layer: int, half_layers: int) -> tuple[float, float]:
    """Top and bottom of the voxel layers center - half ... center + half of the dermis, below its top.

    They are counted from 1 at the bottom of the reticular layer upwards, as for dermal macules.

    Raises
    ------
    InputError : the middle one lies outside the dermis.
    """
    border_mm = _borders_mm(layers)
    above = DERMIS[: DERMIS.index("reticular") + 1]
    center = sum(layer.voxel_layers for layer in layers if layer.name in above) - center_layer
    count = border_mm.size - 1
    if not 0 <= center < count:
        raise InputError(
            f"center_layer {center_layer} lies outside the dermis",
            where="lesions",
            remedy=f"Use 1 to {center + center_layer}; 1 is the lowest voxel layer of the reticular layer.",
        )
    return float(border_mm[max(0, center - half_layers)]), float(border_mm[min(count, center + half_layers + 1)])


def require_in_dermis(depth_mm: float, layers: Sequence[LayerSpec]) -> None:
    """Raise InputError where a depth below the top of the dermis lies below its bottom."""
    bottom_mm = float(_borders_mm(layers)[-1])
    if depth_mm > bottom_mm + 1e-9:
        raise InputError(
            f"depth_mm {depth_mm:g} lies below the dermis", where="lesions", remedy=f"Use at most {bottom_mm:g}."
        )


def dermis_of_stack(names: Sequence[str], height_mm: np.ndarray) -> tuple[slice, np.ndarray]:
    """The voxel layers of a stack that are dermis, and the depths (D + 1,) of their borders below its top, mm."""
    inside = np.flatnonzero([name in DERMIS for name in names])
    if not inside.size:
        raise InputError("moles and tattoos need layers of the dermis", where="lesions")
    dermis = slice(int(inside[0]), int(inside[-1]) + 1)
    return dermis, border_depths(height_mm[dermis])


def _borders_mm(layers: Sequence[LayerSpec]) -> np.ndarray:
    """Depths (D + 1,) of the borders of the voxel layers of the dermis below its top."""
    dermis = [layer for layer in layers if layer.name in DERMIS]
    heights = [layer.thickness_mm / layer.voxel_layers for layer in dermis]
    return border_depths(np.repeat(heights, [layer.voxel_layers for layer in dermis]))
