"""Which first scatterings are photons and which are computed apart (paper, section 7.1, step 3)."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinrender.photonmap.light import CollimatedLight, Light, SkyLight


def has_single_term(volume: Any, light: Light) -> bool:
    """Whether first scatterings are computed from the light's straight passage; else they must be stored as photons.

    They are when every passage from the lamp is unique and known: flat refracting borders, no pencil, and for a sky
    a laterally uniform, periodic volume.
    """
    if volume.surface_mm is not None or (volume.fresnel_borders and volume.border_mm is not None):
        return False
    if isinstance(light, CollimatedLight):
        return light.radius_mm != 0.0
    if isinstance(light, SkyLight):
        return volume.sides == "periodic" and is_laterally_uniform(volume.palette_index)
    return True


def is_laterally_uniform(palette_index: np.ndarray) -> bool:
    """Whether all columns of the volume are alike."""
    return bool((palette_index == palette_index[:1, :1]).all())
