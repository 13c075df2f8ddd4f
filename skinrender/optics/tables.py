"""Tables over wavelength: the shipped measurements, and the spectra that users bring."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from skinrender.errors import InputError

_DATA = resources.files("skinrender.optics") / "data"


def read_rows(name: str) -> list[dict[str, str]]:
    """Rows of a shipped table as text by column name."""
    return list(csv.DictReader(_without_comments(_DATA.joinpath(name).read_text("utf-8").splitlines())))


@cache
def columns(name: str) -> Mapping[str, np.ndarray]:
    """Numeric columns of a shipped table by name; do not write to them."""
    rows = read_rows(name)
    table = {column: np.array([float(row[column]) for row in rows]) for column in rows[0]}
    for values in table.values():
        values.flags.writeable = False
    return table


def on_bands(name: str, column: str, wavelength_nm: np.ndarray, *, hold_below: bool = False) -> np.ndarray:
    """A column of a shipped table, linearly interpolated onto `wavelength_nm`.

    Parameters
    ----------
    hold_below : below the first row use its value instead of refusing.

    Raises
    ------
    InputError : a wavelength lies outside the table.
    """
    table = columns(name)
    return _interpolate(table["wavelength_nm"], table[column], wavelength_nm, f"table {name}", hold_below)


def spectrum_on_bands(
    spectrum: float | Mapping[float, float], wavelength_nm: np.ndarray, *, where: str | None = None
) -> np.ndarray:
    """A number, or values by wavelength in nm, linearly interpolated onto `wavelength_nm`; (B,) float.

    Raises
    ------
    InputError : a wavelength lies outside the given ones; `where` names the place in the user's file.
    """
    if not isinstance(spectrum, Mapping):
        return np.full(np.shape(wavelength_nm), float(spectrum))
    if not spectrum:
        raise InputError("a table by wavelength needs at least one entry", where=where)
    points = sorted((float(nm), float(value)) for nm, value in spectrum.items())
    nm, values = np.array(points).T
    return _interpolate(nm, values, wavelength_nm, where or "table by wavelength")


def read_spectrum_csv(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (nm, ascending) and values of a two-column CSV file; ``#`` comments and one header line are allowed.

    Raises
    ------
    InputError : unreadable, not two numbers a line, or not ascending.
    """
    try:
        lines = Path(path).read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the spectrum: {error}", where=str(path)) from error
    points: list[tuple[float, float]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        point = _two_numbers(line)
        if point is None and points:
            raise InputError(f"expected 'wavelength_nm,value', got {line.strip()[:60]!r}", where=f"{path}:{number}:1")
        if point is not None:
            points.append(point)
    if not points:
        raise InputError("no 'wavelength_nm,value' lines", where=str(path))
    nm, values = np.array(points).T
    if np.any(np.diff(nm) <= 0):
        raise InputError("the wavelengths must ascend", where=str(path))
    return nm, values


def spectrum_file_on_bands(path: str | Path, wavelength_nm: np.ndarray) -> np.ndarray:
    """`read_spectrum_csv` followed by linear interpolation onto `wavelength_nm`; (B,)."""
    nm, values = read_spectrum_csv(path)
    return _interpolate(nm, values, wavelength_nm, str(path))


def _without_comments(lines: Iterable[str]) -> Iterable[str]:
    return (line for line in lines if not line.startswith("#"))


def _two_numbers(line: str) -> tuple[float, float] | None:
    try:
        nm, value = (float(part) for part in line.split(","))
    except ValueError:
        return None
    return (nm, value) if np.isfinite(nm) and np.isfinite(value) else None


def _interpolate(
    nm: np.ndarray, values: np.ndarray, wavelength_nm: np.ndarray, where: str, hold_below: bool = False
) -> np.ndarray:
    wavelength_nm = np.asarray(wavelength_nm, dtype=float)
    tolerance = 1e-9 * nm[-1]
    outside = wavelength_nm > nm[-1] + tolerance
    if not hold_below:
        outside |= wavelength_nm < nm[0] - tolerance
    if np.any(outside):
        raise InputError(
            f"the band {wavelength_nm[outside].flat[0]:g} nm lies outside its {nm[0]:g} to {nm[-1]:g} nm",
            where=where,
            remedy="choose bands within that range, or give a table that covers them",
        )
    return np.interp(wavelength_nm, nm, values)
