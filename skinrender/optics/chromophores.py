"""Absorption coefficients of what skin is made of, in 1/mm, natural logarithm, over wavelengths in nm.

All take (B,) wavelengths and return (B,) coefficients of the *pure* substance, or of a solution of the given
mass concentration; ``tissue.py`` mixes them.
"""

from __future__ import annotations

import numpy as np

from skinrender.optics import tables

HEMOGLOBIN_G_PER_L = 150.0  # whole blood
_HEMOGLOBIN_G_PER_MOL = 64500.0
_CAROTENE_G_PER_MOL = 537.0
_BILIRUBIN_G_PER_MOL = 585.0
_LN10 = np.log(10.0)
_MM_PER_CM = 10.0


def melanosome(wavelength_nm: np.ndarray, pheomelanin: float = 0.0) -> np.ndarray:
    """Interior of melanosomes, of which the share `pheomelanin` holds pheomelanin and the others eumelanin.

    Eumelanin 6.6e11 (nm)^-3.33 per cm: S. L. Jacques, Skin optics, Oregon Medical Laser Center News (1998); single
    melanosomes vary tenfold around it. Pheomelanin 2.9e15 (nm)^-4.75 per cm, and the blend of the two: C. Donner,
    H. W. Jensen, A spectral BSSRDF for shading human skin, Eurographics Symposium on Rendering (2006).
    """
    nm = np.asarray(wavelength_nm, dtype=float)
    eu, pheo = 6.6e11 / _MM_PER_CM * nm**-3.33, 2.9e15 / _MM_PER_CM * nm**-4.75
    return (1.0 - pheomelanin) * eu + pheomelanin * pheo


def blood(wavelength_nm: np.ndarray, saturation: float) -> np.ndarray:
    """Whole blood of 150 g/L hemoglobin, of which the fraction `saturation` is oxygenated.

    S. Prahl, Optical absorption of hemoglobin, Oregon Medical Laser Center (1999). Table: 360 to 800 nm.
    """
    oxygenated = tables.on_bands("hemoglobin.csv", "hbo2_per_cm_per_M", wavelength_nm)
    deoxygenated = tables.on_bands("hemoglobin.csv", "hb_per_cm_per_M", wavelength_nm)
    extinction = saturation * oxygenated + (1.0 - saturation) * deoxygenated
    return _solution(extinction, HEMOGLOBIN_G_PER_L / _HEMOGLOBIN_G_PER_MOL)


def vessel_flattening(mu_a_blood: np.ndarray, radius_mm: float) -> np.ndarray:
    """Share of its absorption that blood keeps when confined to vessels of this radius: (1 - e^-x)/x, x = 2 mu_a r.

    R. L. P. van Veen, W. Verkruysse, H. J. C. M. Sterenborg, Opt. Lett. 27, 246 (2002).
    """
    x = 2.0 * radius_mm * np.asarray(mu_a_blood, dtype=float)
    return np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)


def water(wavelength_nm: np.ndarray) -> np.ndarray:
    """Pure water. D. J. Segelstein, M.S. thesis, University of Missouri-Kansas City (1981). Table: 360 to 800 nm."""
    return tables.on_bands("water.csv", "water_per_cm", wavelength_nm) / _MM_PER_CM


def fat(wavelength_nm: np.ndarray) -> np.ndarray:
    """Porcine fat. R. L. P. van Veen et al., OSA Biomedical Topical Meeting (2004). Table: 430 to 800 nm.

    Nothing was measured below; the value at 430 nm (0.008 per mm, a twentieth of the baseline's there) is held.
    """
    return tables.on_bands("fat.csv", "fat_per_cm", wavelength_nm, hold_below=True) / _MM_PER_CM


def carotene(wavelength_nm: np.ndarray, g_per_l: float) -> np.ndarray:
    """Beta-carotene dissolved in tissue. H. Du et al., Photochem. Photobiol. 68, 141 (1998). Table: 360 to 800 nm."""
    extinction = tables.on_bands("carotene.csv", "carotene_per_cm_per_M", wavelength_nm)
    return _solution(extinction, g_per_l / _CAROTENE_G_PER_MOL)


def bilirubin(wavelength_nm: np.ndarray, g_per_l: float) -> np.ndarray:
    """Bilirubin dissolved in tissue. H. Du et al., Photochem. Photobiol. 68, 141 (1998). Table: 360 to 800 nm."""
    extinction = tables.on_bands("bilirubin.csv", "bilirubin_per_cm_per_M", wavelength_nm)
    return _solution(extinction, g_per_l / _BILIRUBIN_G_PER_MOL)


def baseline(wavelength_nm: np.ndarray) -> np.ndarray:
    """Tissue without chromophores: 0.244 + 85.3 exp(-(nm - 154)/66.2) per cm.

    S. L. Jacques, Skin optics, Oregon Medical Laser Center News (1998).
    """
    nm = np.asarray(wavelength_nm, dtype=float)
    return (0.244 + 85.3 * np.exp(-(nm - 154.0) / 66.2)) / _MM_PER_CM


def _solution(extinction_per_cm_per_molar: np.ndarray, mol_per_l: float) -> np.ndarray:
    """Beer's law: decadic molar extinction to the absorption coefficient in 1/mm."""
    return _LN10 * extinction_per_cm_per_molar * mol_per_l / _MM_PER_CM
