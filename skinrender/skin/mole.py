"""Moles (melanocytic nevi): nests of pigmented cells that reach from the epidermis down into the dermis.

In the epidermis a mole is darkened as a macule is. Below, the nests of a column reach the deeper the darker its pattern
is, so that the body of the mole is a bowl, and hold less melanin the deeper they lie: nevus cells lose pigment as they
descend (W. F. Lever, G. Schaumburg-Lever, Histopathology of the Skin, 7th ed. (1990)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.skin.dermis import dermis_of_stack

_LEVELS = 255


@dataclass(frozen=True, eq=False)
class Nests:
    """The dermal part of a mole.

    Parameters
    ----------
    p (nx, ny) : melanosome fraction that the pattern adds to the basal layer.
    depth_mm : how far below the top of the dermis the nests of the darkest columns reach.
    share : melanin of the uppermost nests relative to p.
    """

    p: np.ndarray
    depth_mm: float
    share: float

    def darken(
        self, melanin: np.ndarray, names: Sequence[str], height_mm: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """`add_nests` to the columns of pattern values p (C,)."""
        return add_nests(melanin, names, height_mm, p, self.depth_mm, self.share)


def add_nests(
    melanin: np.ndarray, names: Sequence[str], height_mm: np.ndarray, p: np.ndarray, depth_mm: float, share: float
) -> tuple[np.ndarray, int]:
    """Melanin (C, S) with nests in the dermis, and the index of the lowest voxel layer that changed (-1: none).

    The nests of a column reach down to d = depth_mm p / p_max. A voxel layer of the dermis whose middle lies z < d below
    its top gains share p (1 - z/d), rounded to 255ths of share p_max, at most to 1.

    Parameters
    ----------
    height_mm (S,) : heights of the voxel layers.
    p (C,) : pattern values; where one is 0 its column stays as it is.
    """
    largest = float(p.max(initial=0.0))
    if largest <= 0 or share <= 0:
        return melanin.copy(), -1
    dermis, border_mm = dermis_of_stack(names, height_mm)
    z_mm = 0.5 * (border_mm[1:] + border_mm[:-1])
    reach_mm = np.where(p > 0, depth_mm * p / largest, 1.0)[:, None]
    thinned = np.maximum(0.0, 1.0 - z_mm / reach_mm)
    step = share * largest / _LEVELS
    gain = np.zeros(melanin.shape)
    gain[:, dermis] = np.floor(share * p[:, None] * thinned / step + 0.5) * step
    changed = np.flatnonzero(gain.any(axis=0))
    return np.minimum(1.0, melanin + gain), int(changed.max(initial=-1))
