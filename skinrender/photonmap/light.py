"""The lamps: what each sends towards the patch, per band.

A scene gives a lamp's total over its bands; the spectrum shares it out here and nowhere else. With periodic sides each
tile of the patch has its own copy of the lamp, which lights that tile only. Units: mm, W, sr.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinrender.errors import SceneError
from skinrender.optics.illuminants import band_weights
from skinrender.scene import about


@dataclass(frozen=True)
class PointLight:
    """A point source above the patch.

    Attributes
    ----------
    position_mm : (3,), z < 0.
    intensity : (B,) W/sr in each band.
    """

    position_mm: np.ndarray
    intensity: np.ndarray

    def power_aimed_per_band(self, size_mm: tuple[float, float]) -> np.ndarray:
        """Power aimed at the patch's rectangle on the mean plane, (B,) W."""
        return self.intensity * rectangle_solid_angle(self.position_mm, size_mm)


@dataclass(frozen=True)
class CollimatedLight:
    """Parallel light.

    Attributes
    ----------
    direction : (3,) unit direction of flight, z > 0.
    irradiance : (B,) W/mm2 on a plane perpendicular to the beam; for a pencil (radius 0) the power, W.
    radius_mm : None: the whole patch; 0: a pencil; else the beam's radius.
    position_mm : (2,) where the beam's axis meets the mean plane.
    """

    direction: np.ndarray
    irradiance: np.ndarray
    radius_mm: float | None
    position_mm: np.ndarray

    def power_aimed_per_band(self, size_mm: tuple[float, float]) -> np.ndarray:
        """Power aimed at the patch, (B,) W."""
        if self.radius_mm is None:
            return self.irradiance * (self.direction[2] * size_mm[0] * size_mm[1])
        if self.radius_mm == 0.0:
            return self.irradiance.copy()
        return self.irradiance * (math.pi * self.radius_mm**2)


@dataclass(frozen=True)
class SkyLight:
    """Uniform radiance from the whole upper hemisphere: `radiance` (B,) W/mm2/sr in each band."""

    radiance: np.ndarray

    def power_aimed_per_band(self, size_mm: tuple[float, float]) -> np.ndarray:
        """Power aimed at the patch, (B,) W."""
        return self.radiance * (math.pi * size_mm[0] * size_mm[1])


Light = PointLight | CollimatedLight | SkyLight


def light_from_scene(scene: Any) -> Light:
    """The scene's lamp with its total shared over the bands by its spectrum.

    Raises
    ------
    InputError : unknown spectrum, or a beam that reaches beyond the patch.
    """
    light, size_mm = scene.light, tuple(scene.patch.size_mm)
    is_file = light.spectrum.lower().endswith((".csv", ".txt"))
    spectrum = scene.path(light.spectrum) if is_file else light.spectrum
    with about(scene, "light", "spectrum"):
        weights = band_weights(spectrum, np.asarray(scene.wavelength_nm))
    if light.kind == "sky":
        return SkyLight(light.radiance_W_per_mm2_sr * weights)
    center = (0.5 * size_mm[0], 0.5 * size_mm[1])
    position = np.array(light.position_mm or center, dtype=float)
    if light.kind == "point":
        return PointLight(np.array([*position, -light.height_mm]), light.intensity_W_per_sr * weights)
    direction = flight_direction(light.zenith_deg, light.azimuth_deg)
    total = light.power_W if light.radius_mm == 0.0 else light.irradiance_W_per_mm2
    beam = CollimatedLight(direction, total * weights, light.radius_mm, position)
    with about(scene, "light"):
        _check_footprint(beam, size_mm)
    return beam


def flight_direction(zenith_deg: float, azimuth_deg: float) -> np.ndarray:
    """Direction of flight of light that comes from this zenith and azimuth (counted from +x towards +y)."""
    zenith, azimuth = math.radians(zenith_deg), math.radians(azimuth_deg)
    return np.array([-math.sin(zenith) * math.cos(azimuth), -math.sin(zenith) * math.sin(azimuth), math.cos(zenith)])


def rectangle_solid_angle(position_mm: np.ndarray, size_mm: tuple[float, float]) -> float:
    """Solid angle of the rectangle [0, Lx] x [0, Ly] on z = 0, seen from a position above it, sr."""
    x, y, d = position_mm[0], position_mm[1], -position_mm[2]
    quarters = [(a, b) for a in (x, size_mm[0] - x) for b in (y, size_mm[1] - y)]
    return math.fsum(math.atan2(a * b, d * math.sqrt(a * a + b * b + d * d)) for a, b in quarters)


def _check_footprint(beam: CollimatedLight, size_mm: tuple[float, float]) -> None:
    """The emitted power is that of the whole beam, so all of it must fall on the patch."""
    if beam.radius_mm is None:
        return
    stretch = beam.direction[:2] / beam.direction[2]
    reach = beam.radius_mm * np.sqrt(1.0 + stretch**2)
    if np.any(beam.position_mm - reach < 0.0) or np.any(beam.position_mm + reach > size_mm):
        raise SceneError(
            f"the beam of radius {beam.radius_mm:g} mm at {tuple(beam.position_mm.tolist())} reaches beyond the patch",
            key=("radius_mm",),
            remedy="make it smaller, move it, or leave radius_mm out to light the whole patch",
        )
