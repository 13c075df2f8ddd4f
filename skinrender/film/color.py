"""Color: from spectral radiance to luminance, linear sRGB and L*a*b*.

The path of a picture (luminance, RGB, PNG) is numpy with the CIE's numbers, since importing colour-science costs
more than a small picture; L*a*b* and color differences are colour-science's, imported when first asked for.
Radiance is always the radiance *in* a band, so that no width enters a sum over bands.
"""

from __future__ import annotations

import warnings
from functools import cache
from types import ModuleType

import numpy as np

from skinrender.optics import tables
from skinrender.optics.bands import band_width_nm

MM2_PER_M2 = 1e6
SRGB_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # R, G, B, white; IEC 61966-2-1

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
# A light of fewer than about three separate bands has no white that could be adapted to.
_LEAST_CONE_RESPONSE = 0.02


# --- radiance to pictures ---------------------------------------------------------------------------------------


def exposure_for(irradiance: np.ndarray, wavelength_nm: np.ndarray) -> float:
    """Exposure at which a perfect diffuser under this irradiance has Y = 1.

    Parameters
    ----------
    irradiance : (B,) unshadowed irradiance at the patch's center, W mm^-2 in the band; where that is 0 or not
        finite (a pencil of light), its mean over the patch.
    """
    return float(np.pi / (luminosity(wavelength_nm) @ np.asarray(irradiance, dtype=float)))


def y_weights(wavelength_nm: np.ndarray, exposure: float) -> np.ndarray:
    """(B,) weights: ``radiance @ y_weights`` is the luminance Y of radiance in W mm^-2 sr^-1.

    With one band Y is the band's radiance in W m^-2 sr^-1, without exposure.
    """
    if wavelength_nm.size == 1:
        return np.array([MM2_PER_M2])
    return exposure * luminosity(wavelength_nm)


def rgb_matrix(wavelength_nm: np.ndarray, light: np.ndarray, exposure: float) -> np.ndarray:
    """(B, 3) matrix: ``radiance @ rgb_matrix`` is linear sRGB (unclipped) of radiance in W mm^-2 sr^-1.

    The white of the light is adapted to D65 by the Bradford transform, so that a perfect diffuser is neutral:
    R = G = B = Y. Where the bands cannot show color (`shows_color`) all pixels are: R = G = B = Y.

    Parameters
    ----------
    light : (B,) share of the light per band, in any scale.
    """
    if not shows_color(wavelength_nm, light):
        return np.repeat(y_weights(wavelength_nm, exposure)[:, np.newaxis], 3, axis=1)
    cmf = color_matching(wavelength_nm)
    xyz_to_rgb = np.linalg.inv(srgb_to_xyz()) @ _adaptation(_white(cmf, light), _d65_white())
    return exposure * cmf @ xyz_to_rgb.T


def shows_color(wavelength_nm: np.ndarray, light: np.ndarray) -> bool:
    """Whether the lit bands reach all three cone responses, without which there is no white to adapt."""
    cmf = color_matching(wavelength_nm)
    if wavelength_nm.size == 1 or not np.asarray(light, dtype=float) @ cmf[:, 1] > 0:
        return False
    return bool(np.all(_BRADFORD @ _white(cmf, light) > _LEAST_CONE_RESPONSE))


def color_sensitivity(wavelength_nm: np.ndarray, light: np.ndarray) -> np.ndarray:
    """(B,) how far L*a*b* moves, per relative change of the light of one band; the same for all without color.

    CIELAB's derivatives at white (CIE 15:2004): dL* = 116/3 dY/Y, da* = 500/3 (dX/X - dY/Y), db* = 200/3 (dY/Y - dZ/Z).

    Parameters
    ----------
    light : (B,) share of the light per band, in any scale.
    """
    if not shows_color(wavelength_nm, light):
        return np.ones(len(wavelength_nm))
    xyz = np.asarray(light, dtype=float)[:, np.newaxis] * color_matching(wavelength_nm)
    x, y, z = (xyz / xyz.sum(axis=0)).T
    return np.sqrt((116 * y) ** 2 + (500 * (x - y)) ** 2 + (200 * (y - z)) ** 2) / 3


def encode_srgb(rgb: np.ndarray) -> tuple[np.ndarray, float]:
    """8-bit sRGB of linear RGB, and the fraction of pixels that had to be clipped (IEC 61966-2-1)."""
    rgb = np.asarray(rgb, dtype=float)
    half_step = 0.5 / 255.0
    clipped = np.any((rgb < -half_step / 12.92) | (rgb > 1.0 + half_step), axis=-1)
    linear = np.clip(rgb, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * encoded).astype(np.uint8), float(clipped.mean())


# --- observer ----------------------------------------------------------------------------------------------------


def color_matching(wavelength_nm: np.ndarray) -> np.ndarray:
    """(B, 3) color matching functions of the CIE 1931 2 degree observer; 0 outside 380 to 780 nm."""
    table = tables.columns("cie_1931_2_degree.csv")
    nm = table["wavelength_nm"]
    functions = [np.interp(wavelength_nm, nm, table[name], left=0, right=0) for name in ("x_bar", "y_bar", "z_bar")]
    return np.stack(functions, axis=-1)


def luminosity(wavelength_nm: np.ndarray) -> np.ndarray:
    """(B,) weight of each band in Y: the observer's y_bar, or 1 for a single band and for bands that no one sees."""
    y_bar = color_matching(wavelength_nm)[:, 1]
    return np.ones_like(y_bar) if wavelength_nm.size == 1 or not y_bar.any() else y_bar


@cache
def srgb_to_xyz() -> np.ndarray:
    """(3, 3) linear sRGB to XYZ from the primaries and the white, which maps to exactly (1, 1, 1)."""
    xy = np.reshape(SRGB_CHROMATICITIES, (4, 2))
    xyz = np.column_stack([xy / xy[:, 1:], (1.0 - xy.sum(axis=1)) / xy[:, 1]])
    xyz[:, 1] = 1.0
    primaries = xyz[:3].T
    return primaries * np.linalg.solve(primaries, xyz[3])


def _d65_white() -> np.ndarray:
    return srgb_to_xyz().sum(axis=1)


def _white(cmf: np.ndarray, light: np.ndarray) -> np.ndarray:
    white = np.asarray(light, dtype=float) @ cmf
    return white / white[1]


def _adaptation(white: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) Bradford transform of XYZ seen under `white` to XYZ under `target` (K. M. Lam, 1985)."""
    gain = (_BRADFORD @ target) / (_BRADFORD @ white)
    return np.linalg.solve(_BRADFORD, gain[:, np.newaxis] * _BRADFORD)


# --- L*a*b* ------------------------------------------------------------------------------------------------------


def lab_of_factor(radiance_factor: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (..., 3) of spectral radiance or reflectance factors (..., B) under D65, 2 degree observer.

    A perfect diffuser (factor 1) is (100, 0, 0) in any bands. Bands that cannot show color give a* = b* = 0.
    """
    wavelength_nm = np.asarray(wavelength_nm, dtype=float)
    d65 = tables.columns("cie_illuminants.csv")
    light = np.interp(wavelength_nm, d65["wavelength_nm"], d65["D65"], left=0, right=0) * band_width_nm(wavelength_nm)
    if shows_color(wavelength_nm, light):
        matrix = light[:, np.newaxis] * color_matching(wavelength_nm)
    else:
        weight = luminosity(wavelength_nm) * (light if light.any() else 1.0)
        matrix = weight[:, np.newaxis] * _d65_white()
    matrix = matrix / matrix[:, 1].sum()
    return _lab_of_xyz(np.asarray(radiance_factor) @ matrix, matrix.sum(axis=0))


def lab_of_rgb(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (..., 3) of linear sRGB, with (1, 1, 1) as white."""
    return _lab_of_xyz(np.asarray(rgb, dtype=float) @ srgb_to_xyz().T, _d65_white())


def delta_e(lab: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """CIEDE2000 color differences (...,) of L*a*b* (..., 3)."""
    return _colour().difference.delta_E_CIE2000(np.asarray(lab), np.asarray(reference))


def ita_deg(lab: np.ndarray) -> np.ndarray:
    """Individual typology angle atan((L* - 50)/b*) in degrees, (...,); A. Chardon et al. (1991)."""
    lab = np.asarray(lab)
    return np.degrees(np.arctan2(lab[..., 0] - 50.0, lab[..., 2]))


def _lab_of_xyz(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    return _colour().XYZ_to_Lab(xyz / white[1], illuminant=white[:2] / white.sum())


@cache
def _colour() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns at import of optional packages that are absent
        import colour
    return colour
