"""Tattoo inks: absorption of finely dispersed pigment, in 1/mm at volume fraction 1.

Tissue that holds the volume fraction f of an ink absorbs f times this on top of its own.
"""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from skinrender.errors import InputError
from skinrender.optics import tables

_TABLE = "inks.csv"


def ink_absorption(ink: str | Path, wavelength_nm: np.ndarray) -> np.ndarray:
    """Absorption coefficient of an ink at volume fraction 1, (B,) 1/mm.

    Parameters
    ----------
    ink : one of `ink_names`, or the path of a CSV file of ``wavelength_nm,mu_a_per_mm`` lines.

    Raises
    ------
    InputError : unknown name, a broken file, or a band outside of it.
    """
    name = str(ink)
    if name in ink_names():
        return tables.on_bands(_TABLE, name, wavelength_nm)
    if name.lower().endswith(".csv"):
        return tables.spectrum_file_on_bands(ink, wavelength_nm)
    near = difflib.get_close_matches(name, ink_names(), n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(
        f"there is no ink {name!r}",
        remedy=f"{hint}known are {', '.join(ink_names())}; or the path of a CSV file of wavelength_nm,mu_a_per_mm lines",
    )


def ink_names() -> tuple[str, ...]:
    """The inks known by name (optics/data/inks.csv tells their sources)."""
    return tuple(name for name in tables.columns(_TABLE) if name != "wavelength_nm")
