"""What a layer of skin is made of, and the coefficients that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skinrender.errors import InputError
from skinrender.optics import chromophores

_FRACTIONS = ("melanosome", "pheomelanin", "blood", "saturation", "water", "fat", "rayleigh_fraction")


@dataclass(frozen=True)
class Tissue:
    """Composition of one layer; fractions are by volume, the remainder is baseline tissue.

    Parameters
    ----------
    melanosome, pheomelanin : fraction of melanosomes, and the share of them that holds pheomelanin.
    blood, saturation, vessel_radius_um : fraction of whole blood, its oxygen saturation, radius of its vessels
        (0 = blood spread evenly).
    water, fat : fractions of the rest.
    cauchy_a, cauchy_b_nm2 : refractive index a + b / nm^2.
    musp_500nm_per_mm, rayleigh_fraction, mie_power : reduced scattering
        musp (f (nm/500)^-4 + (1 - f) (nm/500)^-power), S. L. Jacques, Phys. Med. Biol. 58, R37 (2013), eq. 2.
    carotene_g_per_l, bilirubin_g_per_l : dissolved in all of the tissue.

    Raises
    ------
    InputError : a fraction outside 0..1, water + fat above 1, or a negative amount.
    """

    melanosome: float = 0.0
    pheomelanin: float = 0.0
    blood: float = 0.0
    saturation: float = 0.0
    vessel_radius_um: float = 0.0
    water: float = 0.0
    fat: float = 0.0
    cauchy_a: float = 1.4
    cauchy_b_nm2: float = 0.0
    musp_500nm_per_mm: float = 0.0
    rayleigh_fraction: float = 0.0
    mie_power: float = 0.0
    carotene_g_per_l: float = 0.0
    bilirubin_g_per_l: float = 0.0

    def __post_init__(self) -> None:
        for name in _FRACTIONS:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{name} must lie in 0..1, got {getattr(self, name)}")
        if self.water + self.fat > 1.0 + 1e-9:
            raise InputError(f"water + fat must not exceed 1, got {self.water} + {self.fat}")
        for name in ("vessel_radius_um", "musp_500nm_per_mm", "carotene_g_per_l", "bilirubin_g_per_l"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name} must not be negative, got {getattr(self, name)}")


class TissueOptics(NamedTuple):
    """Coefficients over bands; `mu_a` is (P, B) when P melanosome fractions were asked for, the others are (B,)."""

    mu_a: np.ndarray
    mu_s: np.ndarray
    g: np.ndarray
    refractive_index: np.ndarray


def tissue_optics(
    tissue: Tissue, wavelength_nm: np.ndarray, melanosome: np.ndarray | float | None = None
) -> TissueOptics:
    """Coefficients of a tissue, in 1/mm.

    Parameters
    ----------
    wavelength_nm : (B,).
    melanosome : fractions that replace the tissue's own, a number or (P,).
    """
    wavelength_nm = np.asarray(wavelength_nm, dtype=float)
    g = anisotropy(wavelength_nm)
    return TissueOptics(
        mu_a=absorption(tissue, wavelength_nm, melanosome),
        mu_s=reduced_scattering(tissue, wavelength_nm) / (1.0 - g),
        g=g,
        refractive_index=tissue.cauchy_a + tissue.cauchy_b_nm2 / wavelength_nm**2,
    )


def absorption(tissue: Tissue, wavelength_nm: np.ndarray, melanosome: np.ndarray | float | None = None) -> np.ndarray:
    """mu_a = M mel + (1-M) [B C blood + (1-B) (W water + F fat + (1-W-F) baseline)] + carotene + bilirubin, 1/mm.

    M is `melanosome` (the tissue's own by default), a number -> (B,) or (P,) -> (P, B); C flattens blood in vessels.
    """
    melanin = np.asarray(tissue.melanosome if melanosome is None else melanosome, dtype=float)[..., np.newaxis]
    if not np.all((melanin >= 0.0) & (melanin <= 1.0)):
        raise InputError("melanosome fractions must lie in 0..1")
    unpigmented = tissue.blood * _blood_in_vessels(tissue, wavelength_nm)
    unpigmented = unpigmented + (1.0 - tissue.blood) * _bloodless(tissue, wavelength_nm)
    dissolved = np.zeros_like(wavelength_nm, dtype=float)
    if tissue.carotene_g_per_l:
        dissolved += chromophores.carotene(wavelength_nm, tissue.carotene_g_per_l)
    if tissue.bilirubin_g_per_l:
        dissolved += chromophores.bilirubin(wavelength_nm, tissue.bilirubin_g_per_l)
    pigment = chromophores.melanosome(wavelength_nm, tissue.pheomelanin)
    return melanin * pigment + (1.0 - melanin) * unpigmented + dissolved


def reduced_scattering(tissue: Tissue, wavelength_nm: np.ndarray) -> np.ndarray:
    """Reduced scattering coefficient, 1/mm: a Rayleigh and a Mie part; this, not mu_s, is what was measured."""
    x = np.asarray(wavelength_nm, dtype=float) / 500.0
    f = tissue.rayleigh_fraction
    return tissue.musp_500nm_per_mm * (f * x**-4.0 + (1.0 - f) * x**-tissue.mie_power)


def anisotropy(wavelength_nm: np.ndarray) -> np.ndarray:
    """Mean cosine of skin: 0.62 + 0.29e-3 nm. M. J. C. van Gemert et al., IEEE Trans. Biomed. Eng. 36, 1146 (1989)."""
    return 0.62 + 0.29e-3 * np.asarray(wavelength_nm, dtype=float)


def _blood_in_vessels(tissue: Tissue, wavelength_nm: np.ndarray) -> np.ndarray:
    if tissue.blood == 0.0:
        return np.zeros_like(wavelength_nm, dtype=float)
    mu_a = chromophores.blood(wavelength_nm, tissue.saturation)
    return mu_a * chromophores.vessel_flattening(mu_a, tissue.vessel_radius_um * 1e-3)


def _bloodless(tissue: Tissue, wavelength_nm: np.ndarray) -> np.ndarray:
    mu_a = (1.0 - tissue.water - tissue.fat) * chromophores.baseline(wavelength_nm)
    if tissue.water:
        mu_a = mu_a + tissue.water * chromophores.water(wavelength_nm)
    if tissue.fat:
        mu_a = mu_a + tissue.fat * chromophores.fat(wavelength_nm)
    return mu_a
