"""The light's spectrum: how its total is shared over the bands."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skinrender.errors import InputError
from skinrender.optics import tables
from skinrender.optics.bands import band_width_nm

_CIE_TABLE = "cie_illuminants.csv"


def band_weights(spectrum: str | Path, wavelength_nm: np.ndarray) -> np.ndarray:
    """Share of the light's total power per band, (B,), summing to 1.

    Parameters
    ----------
    spectrum : name of an illuminant (`illuminant_names`), or path of a CSV file of ``wavelength_nm,value`` lines.

    Raises
    ------
    InputError : unknown name, a band outside the tabulated range, negative values, or no light in any band.
    """
    power = spectral_power(spectrum, wavelength_nm) * band_width_nm(np.asarray(wavelength_nm, dtype=float))
    total = power.sum()
    if not total > 0:
        raise InputError(f"the spectrum {str(spectrum)!r} has no light in any of the scene's bands")
    return power / total


def spectral_power(spectrum: str | Path, wavelength_nm: np.ndarray) -> np.ndarray:
    """Relative spectral power per nm at `wavelength_nm`, (B,), in the spectrum's own scale."""
    wavelength_nm = np.asarray(wavelength_nm, dtype=float)
    name = str(spectrum)
    if name in _FORMULAS:
        return _FORMULAS[name](wavelength_nm)
    if name in illuminant_names():
        return tables.on_bands(_CIE_TABLE, name, wavelength_nm)
    if not _looks_like_file(name):
        raise _unknown(name)
    return tables.spectrum_file_on_bands(spectrum, wavelength_nm)


def illuminant_names() -> tuple[str, ...]:
    """The illuminants known by name (CIE 15:2018)."""
    tabulated = [name for name in tables.columns(_CIE_TABLE) if name != "wavelength_nm"]
    return (*_FORMULAS, *tabulated)


def _illuminant_a(wavelength_nm: np.ndarray) -> np.ndarray:
    """CIE standard illuminant A, CIE 15:2018: Planck's law at 2848 K with c2 = 1.435e7 nm K, 100 at 560 nm."""
    exponent = 1.435e7 / 2848.0
    return 100.0 * (560.0 / wavelength_nm) ** 5 * np.expm1(exponent / 560.0) / np.expm1(exponent / wavelength_nm)


def _equal_energy(wavelength_nm: np.ndarray) -> np.ndarray:
    return np.full_like(wavelength_nm, 100.0)


_FORMULAS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"A": _illuminant_a, "E": _equal_energy}


def _looks_like_file(name: str) -> bool:
    return name.lower().endswith((".csv", ".txt")) or "/" in name or "\\" in name


def _unknown(name: str) -> InputError:
    known = illuminant_names()
    near = difflib.get_close_matches(name.upper(), known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return InputError(
        f"there is no illuminant {name!r}",
        remedy=f"{hint}known are {', '.join(known)}; or the path of a CSV file of wavelength_nm,value lines",
    )
