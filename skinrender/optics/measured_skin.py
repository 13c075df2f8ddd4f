"""Measured reflectances of living skin that a spectrum is held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinrender.optics import tables

TONES = ("very_light", "light", "intermediate", "tan", "brown")
_ISSA = "skin_reflectance_issa.csv"
_NIST, _NIST_SPREAD = "skin_reflectance_nist.csv", "skin_reflectance_nist_spread.csv"
_JAPANESE_NM = (400.0, 700.0)
_SITES = {"forearm": ("JP_inner_arm", "Japanese inner arm"), "cheek": ("JP_cheek", "Japanese cheek")}


@dataclass(frozen=True, eq=False)
class MeasuredSkin:
    """Mean and standard deviation over subjects, specular included; W wavelengths.

    Parameters
    ----------
    name, source : who was measured where, and the publication.
    wavelength_nm, mean, sd : (W,).
    least, largest : (W,) of any subject, where known.
    """

    name: str
    source: str
    wavelength_nm: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    least: np.ndarray | None = None
    largest: np.ndarray | None = None

    def on_bands(self, wavelength_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (B,) interpolated onto bands; not a number outside what was measured."""
        nm, outside = self.wavelength_nm, {"left": np.nan, "right": np.nan}
        return np.interp(wavelength_nm, nm, self.mean, **outside), np.interp(wavelength_nm, nm, self.sd, **outside)


def measured_at(site: str, tone: str | None = None) -> MeasuredSkin | None:
    """The measured table that a body site's preset, or a tone of the forearm, stands for.

    Without a tone 118 Japanese, contact spectrophotometer, 400 to 700 nm: International Skin Spectra Archive, Y. Lu et
    al. (2025), release of 17 January 2025.
    """
    if tone is not None:
        return measured_tone(tone) if site == "forearm" else None
    if site not in _SITES:
        return None
    column, name = _SITES[site]
    table = tables.columns(_ISSA)
    nm = table["wavelength_nm"]
    rows = (nm >= _JAPANESE_NM[0]) & (nm <= _JAPANESE_NM[1])
    mean, sd = (table[f"{column}_{part}"][rows] for part in ("mean", "sd"))
    return MeasuredSkin(name, "ISSA, Lu et al. 2025", nm[rows], mean, sd)


def measured_tone(tone: str) -> MeasuredSkin:
    """The volar forearms of an ITA class, one of `TONES`: 8 degrees/hemispherical, specular included, 380 to 780 nm.

    C. C. Cooksey, D. W. Allen, B. K. Tsai, J. Res. NIST 122, 26 (2017); of 100 subjects 18, 63, 10, 4 and 5.
    """
    mean, spread = tables.columns(_NIST), tables.columns(_NIST_SPREAD)
    return MeasuredSkin(
        f"{tone.replace('_', ' ')} forearms", "NIST, Cooksey et al. 2017", mean["wavelength_nm"], mean[f"ita_{tone}"],
        *(spread[f"{tone}_{name}"] for name in ("sd", "min", "max")),
    )  # fmt: skip
