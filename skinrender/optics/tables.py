"""Tables over wavelength: the shipped measurements, and the spectra that users bring."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from skinrender.errors import InputError

_DATA = resources.files("skinrender.optics") / "data"
_SPECTRUM_CSV = "write one 'wavelength_nm,value' pair of numbers a line, by rising wavelength; # starts a comment"
_MAX_CHARACTERS = 1_000_000


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
    InputError : unreadable, not two numbers a line, not ascending, or a negative value; the message names the line.
    """
    try:
        with open(path, encoding="utf-8-sig") as file:
            text = file.read(_MAX_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the spectrum: {error}", where=str(path)) from error
    if len(text) > _MAX_CHARACTERS:
        raise InputError(f"is larger than {_MAX_CHARACTERS // 1000} kB", where=str(path), remedy="a spectrum is short text")
    points: list[tuple[float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        point = _two_numbers(line)
        wrong = _wrong_with(point, points, line)
        if wrong:
            raise InputError(wrong, where=f"{path}:{number}:1", remedy=_SPECTRUM_CSV)
        if point is not None:
            points.append(point)
    if not points:
        raise InputError("no 'wavelength_nm,value' lines", where=str(path), remedy=_SPECTRUM_CSV)
    nm, values = np.array(points).T
    return nm, values


def _wrong_with(point: tuple[float, float] | None, before: Sequence[tuple[float, float]], line: str) -> str | None:
    """What is wrong with a line of a spectrum's file after the points ``before``; a header before the first is not."""
    if point is None:
        return f"expected 'wavelength_nm,value', got {line.strip()[:60]!r}" if before else None
    if before and point[0] <= before[-1][0]:
        return f"the wavelengths must ascend, got {point[0]:g} after {before[-1][0]:g} nm"
    return f"the values of a spectrum must not be negative, got {point[1]:g}" if point[1] < 0 else None


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
