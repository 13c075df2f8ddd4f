"""Macules: melanin added to columns of voxels by the rules of the paper (sections 5 and 6, equation 1).

Works on voxel layers, top to bottom, as arrays (columns, voxel layers): ``melanin`` holds the content of each,
``names`` the layer that each belongs to. ``p`` is the pattern value of each column; where it is 0 nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.errors import InputError
from skinrender.skin.anatomy import DERMIS
from skinrender.skin.dermis import center_of_layers

_TIE = 1e-9
"""Keeps 9 x 0.5 at 4.5 when the product comes out as 4.4999999999999996."""


def round_half_up(x: np.ndarray) -> np.ndarray:
    """floor(x + 1/2) as integers."""
    return np.floor(np.asarray(x) + 0.5 + _TIE).astype(np.int64)


def darken_epidermis(melanin: np.ndarray, names: Sequence[str], p: np.ndarray) -> np.ndarray:
    """Melanin (C, S) after an epidermal macule of pattern values p (C,) (paper section 5).

    The basal layer gains p, at most to 1. Of the N granular-spinous voxel layers the round(N M_b) next above it are
    darkened, falling linearly from the basal content M_b to their own, which is never undercut.
    """
    basal, spinous = _of(names, "basal"), _of(names, "granular_spinous")[::-1]
    result = melanin.copy()
    changed = p > 0
    result[:, basal] = np.where(changed[:, None], np.minimum(1.0, melanin[:, basal] + p[:, None]), melanin[:, basal])
    content = result[:, basal[0]]
    count = np.where(changed, round_half_up(len(spinous) * content), 0)
    for j, layer in enumerate(spinous, 1):
        own = melanin[:, layer]
        risen = content + (own - content) * j / (count + 1)
        result[:, layer] = np.where(j <= count, np.maximum(own, risen), own)
    return result


@dataclass(frozen=True, eq=False)
class DermalMacule:
    """A dermal macule with its pattern read.

    Parameters
    ----------
    p (nx, ny) : pattern values.
    center_layer, half_layers : see `darken_dermis`.
    """

    p: np.ndarray
    center_layer: int
    half_layers: int

    def darken(
        self, melanin: np.ndarray, names: Sequence[str], height_mm: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """`darken_dermis` in the columns of pattern values p (C,)."""
        return darken_dermis(melanin, names, p, self.center_layer, self.half_layers)


def darken_dermis(
    melanin: np.ndarray, names: Sequence[str], p: np.ndarray, center_layer: int, half_layers: int
) -> tuple[np.ndarray, int]:
    """Melanin (C, S) after a dermal macule, and the index of the lowest voxel layer that it changed (-1: none).

    Voxel layer a = ``center_layer``, counted from 1 at the bottom of the reticular layer upwards, and n_i above and
    below it gain the largest pattern value, at most to 1, within the dermis; n_i = round(n p / p_max) with
    n = ``half_layers`` (paper section 6, equation 1).
    """
    center = center_of_layers(names, center_layer)
    dermis = [i for i, name in enumerate(names) if name in DERMIS]
    largest = float(p.max(initial=0.0))
    if largest <= 0:
        return melanin.copy(), -1
    reach = round_half_up(half_layers * p / largest)[:, None]
    layer = np.arange(melanin.shape[1])
    changed = (p > 0)[:, None] & (np.abs(layer - center) <= reach) & (layer >= dermis[0]) & (layer <= dermis[-1])
    return np.where(changed, np.minimum(1.0, melanin + largest), melanin), int(np.flatnonzero(changed.any(0))[-1])


def merge_below(layer: np.ndarray, height_mm: np.ndarray, lowest: int) -> tuple[np.ndarray, np.ndarray]:
    """Groups of voxel layers after a dermal macule: below voxel layer ``lowest`` each layer becomes a single one.

    Parameters
    ----------
    layer, height_mm (S,) : layer index and height of the voxel layers.

    Returns
    -------
    first (T,) : the uppermost member of each remaining voxel layer; height_mm (T,).
    """
    starts = np.ones(layer.size, bool)
    starts[lowest + 2 :] = layer[lowest + 2 :] != layer[lowest + 1 : -1]
    first = np.flatnonzero(starts)
    return first, np.add.reduceat(height_mm, first)


def _of(names: Sequence[str], wanted: str) -> list[int]:
    found = [i for i, name in enumerate(names) if name == wanted]
    if not found:
        raise InputError(f"a macule needs a layer named {wanted}")
    return found
