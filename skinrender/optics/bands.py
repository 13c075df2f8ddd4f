"""Wavelength bands: the discrete spectrum in which light is walked, stored and seen."""

from __future__ import annotations

import numpy as np


def band_width_nm(wavelength_nm: np.ndarray) -> np.ndarray:
    """Width of each band, (B,) nm: half the distance between its neighbors, at the ends the distance to the only one.

    A single band is monochromatic; its width is 1 by convention and cancels wherever it is used.
    """
    if wavelength_nm.size == 1:
        return np.ones(1)
    return np.gradient(wavelength_nm)
