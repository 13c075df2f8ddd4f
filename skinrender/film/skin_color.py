"""Numbers by which dermatology names the color of skin, from its spectral reflectance."""

from __future__ import annotations

import numpy as np

MELANIN_NM = 655.0
ERYTHEMA_NM = 568.0
ITA_CLASSES = (("very light", 55.0), ("light", 41.0), ("intermediate", 28.0), ("tan", 10.0), ("brown", -30.0))


def ita_class(ita_deg: float) -> str:
    """Class of an individual typology angle: very light > 55 > light > 41 > intermediate > 28 > tan > 10 > brown > -30 > dark.

    A. Chardon, I. Cretois, C. Hourseau, Int. J. Cosmet. Sci. 13, 191 (1991); the sixth class: S. Del Bino, F. Bernerd,
    Br. J. Dermatol. 169 (s3), 33 (2013).
    """
    return next((name for name, lowest_deg in ITA_CLASSES if ita_deg > lowest_deg), "dark")


def melanin_index(reflectance: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """100 log10(1/R(655 nm)) of reflectances (..., B), interpolated between bands; not a number beyond them.

    The two-wavelength meter of B. L. Diffey, R. J. Oliver, P. M. Farr, Br. J. Dermatol. 111, 663 (1984), with the bands
    and definitions of H. Takiwaki, L. Overgaard, J. Serup, Skin Pharmacol. 7, 217 (1994).
    """
    return -100.0 * np.log10(_at(MELANIN_NM, reflectance, wavelength_nm))


def erythema_index(reflectance: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """100 log10(R(655 nm)/R(568 nm)) of reflectances (..., B); sources and interpolation as `melanin_index`."""
    return 100.0 * np.log10(_at(MELANIN_NM, reflectance, wavelength_nm) / _at(ERYTHEMA_NM, reflectance, wavelength_nm))


def _at(nm: float, reflectance: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    reflectance = np.asarray(reflectance, dtype=float)
    if not wavelength_nm[0] <= nm <= wavelength_nm[-1]:
        return np.full(reflectance.shape[:-1], np.nan)
    above = max(1, int(np.searchsorted(wavelength_nm, nm)))
    if len(wavelength_nm) == 1:
        return reflectance[..., 0]
    share = (nm - wavelength_nm[above - 1]) / (wavelength_nm[above] - wavelength_nm[above - 1])
    return (1.0 - share) * reflectance[..., above - 1] + share * reflectance[..., above]
