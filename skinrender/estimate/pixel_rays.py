"""The view rays of a picture's pixels: one or several each, and what they tell together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skinrender.estimate.lattice import RayLattice
from skinrender.skin.volume import SkinVolume


@dataclass(frozen=True, eq=False)
class PixelRays:
    """The rays of a lattice, and the pixels they belong to.

    Parameters
    ----------
    lattice : k x k rays a pixel, to which photons are connected: one where the surface is flat. On a relief the tissue
        is of uneven thickness within a voxel, and the light inside follows it: one ray a pixel would be 5 % off.
    shape : (h, w) of the picture.
    """

    volume: SkinVolume
    lattice: RayLattice
    shape: tuple[int, int]

    @property
    def subpixels(self) -> int:
        """Rays along each side of a pixel."""
        return self.lattice.shape[0] // self.shape[0]

    @cached_property
    def pixel_of(self) -> np.ndarray:
        """Pixel of each ray, (Q,) int32."""
        return pixels_of_rays(self.shape, self.subpixels)

    def pixel_mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over the rays of each pixel, (..., Q) to (..., h w)."""
        h, w = self.shape
        k = self.subpixels
        lead = values.shape[:-1]
        return values.reshape(*lead, h, k, w, k).mean(axis=(-3, -1)).reshape(*lead, h * w)

    @cached_property
    def covers_patch(self) -> bool:
        """Whether the lattice repeats seamlessly with a periodic patch."""
        low_x, low_y, high_x, high_y = self.lattice.bounds[0]
        size = [high_x - low_x, high_y - low_y]
        return self.volume.sides == "periodic" and bool(np.allclose(size, self.volume.size_mm, rtol=1e-3))


def pixels_of_rays(shape: tuple[int, int], subpixels: int) -> np.ndarray:
    """Pixel of each ray of an (h, w) picture with so many along each side of a pixel, (Q,) int32."""
    pixel = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape)
    return np.repeat(np.repeat(pixel, subpixels, axis=0), subpixels, axis=1).ravel()
