"""Depths in the dermis, where moles and tattoos lie: in mm below its top, or in voxel layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinrender.errors import InputError, SceneError
from skinrender.skin.anatomy import DERMIS, LayerSpec, border_depths


def dermis_mm(layers: Sequence[LayerSpec]) -> tuple[float, float]:
    """Depths of the top and the bottom of the dermis below the surface."""
    top_mm = sum(layer.thickness_mm for layer in layers[: next(i for i, at in enumerate(layers) if at.name in DERMIS)])
    return top_mm, top_mm + float(_borders_mm(layers)[-1])


def depth_of_layers_mm(layers: Sequence[LayerSpec], voxel_layers: int) -> float:
    """Height of the uppermost voxel layers of the dermis; SceneError where it has fewer."""
    border_mm = _borders_mm(layers)
    if voxel_layers >= border_mm.size:
        raise SceneError(
            f"{voxel_layers} voxel layers reach below the dermis", key=("depth_layers",), remedy=f"Use 1 to {border_mm.size - 1}."
        )
    return float(border_mm[voxel_layers])


def range_of_layers_mm(layers: Sequence[LayerSpec], center_layer: int, half_layers: int) -> tuple[float, float]:
    """Top and bottom of the voxel layers center - half ... center + half of the dermis, below its top.

    See `center_of_layers`, which also tells what it raises.
    """
    border_mm, names = _borders_mm(layers), voxel_layer_names(layers)
    center, count = center_of_layers(names, center_layer) - _inside(names)[0], border_mm.size - 1
    return float(border_mm[max(0, center - half_layers)]), float(border_mm[min(count, center + half_layers + 1)])


def voxel_layer_names(layers: Sequence[LayerSpec]) -> list[str]:
    """The layer that each voxel layer belongs to, top to bottom."""
    return [layer.name for layer in layers for _ in range(layer.voxel_layers)]


def center_of_layers(names: Sequence[str], center_layer: int) -> int:
    """Index among voxel layers of these names of the one counted from 1 at the bottom of the reticular layer upwards.

    Raises
    ------
    SceneError : it lies outside the dermis.
    """
    inside = _inside(names)
    bottom = int(np.flatnonzero(np.array(names) == "reticular")[-1])
    center = bottom + 1 - center_layer
    if center not in inside:
        raise SceneError(
            f"center_layer {center_layer} lies outside the dermis",
            key=("center_layer",),
            remedy=f"Use 1 to {bottom + 1 - inside[0]}; 1 is the lowest voxel layer of the reticular layer.",
        )
    return center


def require_in_dermis(depth_mm: float, layers: Sequence[LayerSpec]) -> None:
    """Raise SceneError where a depth below the top of the dermis lies below its bottom."""
    bottom_mm = float(_borders_mm(layers)[-1])
    if depth_mm > bottom_mm + 1e-9:
        raise SceneError(
            f"depth_mm {depth_mm:g} lies below the dermis", key=("depth_mm",), remedy=f"Use at most {bottom_mm:g}."
        )


def dermis_of_stack(names: Sequence[str], height_mm: np.ndarray) -> tuple[slice, np.ndarray]:
    """The voxel layers of a stack that are dermis, and the depths (D + 1,) of their borders below its top, mm."""
    inside = _inside(names)
    dermis = slice(int(inside[0]), int(inside[-1]) + 1)
    return dermis, border_depths(height_mm[dermis])


def _inside(names: Sequence[str]) -> np.ndarray:
    """Which of the voxel layers are dermis, ascending."""
    inside = np.flatnonzero([name in DERMIS for name in names])
    if not inside.size:
        raise InputError("lesions need layers of the dermis")
    return inside


def _borders_mm(layers: Sequence[LayerSpec]) -> np.ndarray:
    """Depths (D + 1,) of the borders of the voxel layers of the dermis below its top."""
    dermis = [layer for layer in layers if layer.name in DERMIS]
    heights = [layer.thickness_mm / layer.voxel_layers for layer in dermis]
    return border_depths(np.repeat(heights, [layer.voxel_layers for layer in dermis]))
