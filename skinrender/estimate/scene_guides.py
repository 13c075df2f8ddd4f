"""The guides of a scene's picture (see `guide`): what is known of its light's pattern without any photon."""

from __future__ import annotations

import numpy as np

from skinrender.estimate.guide import Guides, color_patterns, patterns, side_patterns
from skinrender.estimate.pixel_rays import PixelRays
from skinrender.estimate.radius import COLOR_WIDER, WIDEST_MM, at_columns, is_alike, lesion_absorbance
from skinrender.estimate.surface import entering_light, has_direction
from skinrender.photonmap.light import Light


def scene_guides(pixels: PixelRays, light: Light) -> Guides | None:
    """The guides of the light's pattern; None where there is none."""
    rays, volume = pixels.lattice.rays, pixels.volume
    grid = pixels.lattice.spacing_mm * pixels.subpixels, pixels.covers_patch
    pixel_entry = pixels.pixel_mean(rays.entry.T)[:2].T
    height, lamp = None, []
    if volume.has_relief:
        height = _in_pixels(pixels, rays.entry[:, 2])
        if has_direction(light):
            lamp = [_in_pixels(pixels, entering_light(rays.entry, rays.hit, volume, light))]
    found = Guides(
        relief=patterns(lamp, height, *grid),
        lesion=patterns(_let_through(pixels, WIDEST_MM), None, *grid),
        color=color_patterns(_let_through(pixels, COLOR_WIDER * WIDEST_MM), *grid),
        sides=[] if volume.sides == "periodic" else side_patterns(pixel_entry, volume.size_mm, pixels.shape),
    )
    return found if any(map(len, found)) else None


def _in_pixels(pixels: PixelRays, values: np.ndarray) -> np.ndarray:
    """Values of the rays (Q,) as a picture (h, w)."""
    return pixels.pixel_mean(values).reshape(pixels.shape)


def _let_through(pixels: PixelRays, deepest_mm: float) -> list[np.ndarray]:
    """What lesions let through down to a depth, (h, w); nothing where they are alike everywhere."""
    absorbance = lesion_absorbance(pixels.volume, deepest_mm)
    if is_alike(absorbance):
        return []
    through = at_columns(np.exp(-absorbance), pixels.lattice.rays.entry, pixels.volume.size_mm)
    return [_in_pixels(pixels, through)]
