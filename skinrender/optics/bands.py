"""Wavelength bands: the discrete spectrum in which light is walked, stored and seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinrender.errors import InputError

MAX_BANDS = 256  # a photon names its band in one byte


def band_range(start: float = 380.0, stop: float = 780.0, step: float = 5.0) -> np.ndarray:
    """Central wavelengths from `start` to `stop` inclusive, in nm.

    Raises
    ------
    InputError : `step` is not positive, or `stop` is not reached in whole steps.
    """
    if not step > 0:
        raise InputError(f"the step of the bands must be positive, got {step:g} nm")
    steps = (stop - start) / step
    if not np.isfinite(steps) or steps < 0 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"bands from {start:g} to {stop:g} nm are not a whole number of steps of {step:g} nm",
            remedy="choose stop = start + n * step",
        )
    if steps >= MAX_BANDS:
        raise InputError(f"{round(steps) + 1} bands are too many, at most {MAX_BANDS} are possible")
    return band_list(start + step * np.arange(round(steps) + 1))


def band_list(wavelength_nm: Sequence[float] | np.ndarray) -> np.ndarray:
    """Central wavelengths given one by one, as an ascending (B,) float array in nm.

    Raises
    ------
    InputError : none or more than 256 of them, not ascending, or not positive and finite.
    """
    wavelength_nm = np.array(wavelength_nm, dtype=float)
    if wavelength_nm.ndim != 1 or not 1 <= wavelength_nm.size <= MAX_BANDS:
        raise InputError(f"between 1 and {MAX_BANDS} bands are possible, got {wavelength_nm.size}")
    if not np.all(np.isfinite(wavelength_nm)) or wavelength_nm[0] <= 0 or np.any(np.diff(wavelength_nm) <= 0):
        raise InputError("the wavelengths of the bands must be positive and ascending, in nm")
    return wavelength_nm


def band_width_nm(wavelength_nm: np.ndarray) -> np.ndarray:
    """Width of each band, (B,) nm: half the distance between its neighbors, at the ends the distance to the only one.

    A single band is monochromatic; its width is 1 by convention and cancels wherever it is used.
    """
    if wavelength_nm.size == 1:
        return np.ones(1)
    return np.gradient(wavelength_nm)
