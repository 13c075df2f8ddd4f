"""Which first scatterings are photons and which are computed apart (paper, section 7.1, step 3)."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinrender.photonmap.light import CollimatedLight, Light, SkyLight

NARROW = 0.05
"""Radius of a beam in sides of the patch."""


def has_single_term(volume: Any, light: Light) -> bool:
    """Whether first scatterings are computed from the light's straight passage; else they must be stored as photons."""
    return why_no_single_term(volume, light) is None


def why_no_single_term(volume: Any, light: Light) -> str | None:
    """Why first scatterings are stored as photons; None where they are computed.

    They are computed when every passage from the lamp is unique and known: flat refracting borders, no pencil or beam so
    narrow that it may pass between the view rays, and for a sky a laterally uniform, periodic volume.
    """
    if volume.surface_mm is not None:
        return "through a relief, light reaches a point on several passages or none"
    if volume.fresnel_borders and volume.border_mm is not None:
        return "through wavy borders that refract, light reaches a point on several passages or none"
    if isinstance(light, CollimatedLight) and light.radius_mm == 0.0:
        return "a pencil's first scatterings lie on one line"
    if isinstance(light, CollimatedLight) and (light.radius_mm or np.inf) < NARROW * min(volume.size_mm):
        return "the beam is so narrow that it may pass between the view rays"
    if isinstance(light, SkyLight):
        if volume.sides != "periodic":
            return "the sky's light through the sides is not known"
        if not is_laterally_uniform(volume.palette_index):
            return "the sky's light in tissue that varies sideways is not known in closed form"
    return None


def is_laterally_uniform(palette_index: np.ndarray) -> bool:
    """Whether all columns of the volume are alike."""
    return bool((palette_index == palette_index[:1, :1]).all())
