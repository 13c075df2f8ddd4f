"""Pictures in memory: spectral, as this program makes them, and plain RGB, as others may."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from skinrender.film import color


@dataclass(frozen=True, eq=False)
class SpectralImage:
    """Spectral radiance of a view, with the luminance of its parts.

    Parameters
    ----------
    radiance : (h, w, B) float32, W mm^-2 sr^-1 in the band.
    wavelength_nm : (B,).
    surface_Y, single_Y, multiple_Y, stderr_Y : (h, w) float32, in the unit of `y`.
    irradiance : (h, w, B) float32, W mm^-2 in the band: unshadowed, on the mean plane under the pixel.
    exposure : `color.exposure_for` the patch's center.
    provenance : JSON-like, what determined the picture.
    """

    radiance: np.ndarray
    wavelength_nm: np.ndarray
    surface_Y: np.ndarray
    single_Y: np.ndarray
    multiple_Y: np.ndarray
    stderr_Y: np.ndarray
    irradiance: np.ndarray
    exposure: float
    provenance: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        height, width, bands = self.radiance.shape
        if self.wavelength_nm.shape != (bands,):
            raise ValueError(f"{bands} bands of radiance but wavelengths of shape {self.wavelength_nm.shape}")
        if self.irradiance.shape != self.radiance.shape:
            raise ValueError(f"irradiance has shape {self.irradiance.shape}, radiance {self.radiance.shape}")
        for name in ("surface_Y", "single_Y", "multiple_Y", "stderr_Y"):
            if getattr(self, name).shape != (height, width):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {(height, width)}")

    @cached_property
    def light(self) -> np.ndarray:
        """(B,) share of the light per band; equal shares where no pixel is lit."""
        total = self.irradiance.sum(axis=(0, 1), dtype=float)
        return total / total.sum() if total.any() else np.full(total.size, 1.0 / total.size)

    def y(self) -> np.ndarray:
        """(h, w) luminance, 1 for a perfect diffuser at the patch's center; one band: its W m^-2 sr^-1."""
        return self.radiance @ color.y_weights(self.wavelength_nm, self.exposure)

    def rgb(self) -> np.ndarray:
        """(h, w, 3) linear sRGB adapted to D65, unclipped; one band: R = G = B = `y`."""
        return self.radiance @ color.rgb_matrix(self.wavelength_nm, self.light, self.exposure)

    def display_rgb(self) -> np.ndarray:
        """(h, w, 3) linear sRGB for a screen: `rgb`, exposed also where there is one band."""
        if self.wavelength_nm.size == 1:
            return np.repeat(self.exposure * self.radiance.astype(float), 3, axis=2)
        return self.rgb()

    def radiance_factor(self) -> np.ndarray:
        """(h, w, B) pi L / E: radiance relative to a perfect diffuser's; 0 where no light falls."""
        lit = self.irradiance > 0
        return np.divide(np.pi * self.radiance, self.irradiance, out=np.zeros_like(self.radiance), where=lit)

    def lab(self) -> np.ndarray:
        """(h, w, 3) L*a*b* of the radiance factor under D65 and the 2 degree observer, whatever the lamp.

        Of the bands that the lamp has; in the others nothing is known.
        """
        lit = self.light > 0
        return color.lab_of_factor(self.radiance_factor()[..., lit], self.wavelength_nm[lit])


@dataclass(frozen=True, eq=False)
class RgbImage:
    """A picture of which only linear sRGB is known: `linear` (h, w, 3)."""

    linear: np.ndarray
    provenance: dict = field(default_factory=dict)

    def y(self) -> np.ndarray:
        """(h, w) luminance of the RGB."""
        return self.linear @ color.srgb_to_xyz()[1]

    def rgb(self) -> np.ndarray:
        """(h, w, 3) linear sRGB."""
        return self.linear

    def lab(self) -> np.ndarray:
        """(h, w, 3) L*a*b* with RGB (1, 1, 1) as white."""
        return color.lab_of_rgb(self.linear)
