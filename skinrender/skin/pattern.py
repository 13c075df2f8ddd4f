"""Macule patterns: gray images whose darkness is the added melanin of each column of voxels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinrender.skin.gray import read_gray

_LEVELS = 255


def read_pattern(path: str | Path, columns: tuple[int, int], melanin_scale: float) -> np.ndarray:
    """Pattern values p (nx, ny) of a PNG: its darkness (black 1, white 0) times ``melanin_scale``.

    A pattern of more than 256 gray levels is rounded to 255ths of its darkest, which keeps the palette small.

    Raises
    ------
    InputError : the file is absent, no PNG, damaged, or its size is not (nx, ny).
    """
    darkness = 1.0 - read_gray(path, ("PNG",), pixels=columns)
    if np.unique(darkness).size > _LEVELS + 1:
        step = darkness.max() / _LEVELS
        darkness = np.floor(darkness / step + 0.5) * step
    return darkness * melanin_scale
