"""Tattoos: ink in a range of depths in the dermis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.skin.dermis import dermis_of_stack


@dataclass(frozen=True, eq=False)
class Tattoo:
    """A tattoo with its pattern read.

    Parameters
    ----------
    p (nx, ny) : volume fractions of ink.
    ink : its place in the scene's list of inks.
    depth_mm : top and bottom of the ink below the top of the dermis.
    """

    p: np.ndarray
    ink: int
    depth_mm: tuple[float, float]


def add_ink(
    fraction: np.ndarray, names: Sequence[str], height_mm: np.ndarray, p: np.ndarray, depth_mm: tuple[float, float]
) -> tuple[np.ndarray, int]:
    """Ink (C, S) after a tattoo of volume fractions p (C,), and the index of the lowest voxel layer it is in (-1: none).

    A voxel layer of the dermis gains p times the part of its height within the range, so that the ink under an area
    does not depend on the voxel layers; at most to 1.
    """
    dermis, border_mm = dermis_of_stack(names, height_mm)
    common_mm = np.minimum(border_mm[1:], depth_mm[1]) - np.maximum(border_mm[:-1], depth_mm[0])
    part = np.zeros(len(names))
    part[dermis] = np.round(np.clip(common_mm / np.diff(border_mm), 0.0, 1.0), 9)
    gain = p[:, None] * part
    changed = np.flatnonzero(gain.any(axis=0))
    return np.minimum(1.0, fraction + gain), int(changed.max(initial=-1))
