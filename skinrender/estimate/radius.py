"""Kernel radii: as wide as the wanted gather count says, narrower where the tissue changes sideways.

Each beam uses its own transmittance, so a wide kernel is nearly free of bias where the light inside is smooth sideways
(up to about the transport mean free path). Next to a hard-edged lesion it is not: there the radius is bounded such that
the kernel's mean of the absorbance that the lesion adds stays near its value at the ray. A gradient costs nothing, as
the kernel is symmetric.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.estimate.kernel_filter import correlate, gaussian
from skinrender.skin.volume import SkinVolume

WIDEST_MM = 0.4
"""Wider kernels begin to blur; on uniform tissue with walls at the sides the mean is 0.25 % low at 0.4 mm."""
ALIKE = 0.03
"""Largest difference between the kernel's mean of the added vertical absorbance and its value at the ray."""
COLOR_WIDER = 3.0
"""Kernel of the spectra's shape over that of the luminance. Nothing bounds it: what it flattens is restored, see `guide`."""
EPIDERMIS_MM = 0.15
LIGHT_DEPTH_MM = 0.4
"""How far below the epidermis light goes that returns: 0.2 mm in the mean at 440 nm, 0.7 at 640 nm (`make lesion-table`)."""
REFERENCE_NM = 450.0
STEPS = (1.5, 2.2, 3.2, 4.6, 6.8, 10.0, 15.0, 22.0, 32.0)
"""Radii in pixels that a bounded kernel may take. Narrower ones, where a pattern is noisy, only add speckle."""


def gather_radius_mm(gather_count: int | None, photons: int, size_mm: tuple[float, float]) -> float:
    """Radius at which a beam meets `gather_count` of the photons under the patch; `WIDEST_MM` at most and for None."""
    if gather_count is None:
        return WIDEST_MM
    per_area = photons / (size_mm[0] * size_mm[1])
    return min(WIDEST_MM, math.sqrt(gather_count / (math.pi * max(per_area, 1e-12))))


def lesion_absorbance(volume: SkinVolume, deepest_mm: float) -> np.ndarray:
    """Vertical absorbance by column, (nx, ny), that lesions add down to a depth, as the light under the surface knows of it.

    In the band from 450 nm on where they add most: there for melanin, in the red for a blue ink. Pigment in the epidermis
    takes its transmittance from the light that enters. Deeper pigment takes that of both ways, but only from the light that
    has been there, exp(-depth / `LIGHT_DEPTH_MM`) of it.
    """
    added = _added_mu_a(volume)
    if not added.any():
        return np.zeros(volume.shape[:2])
    tissue = volume.palette_layer > 0
    depth, passed = np.zeros(volume.shape[:2]), np.ones(volume.shape[:2])
    light = np.ones(volume.shape[:2])
    for k, thickness in enumerate(np.diff(volume.z_edges_mm)):
        entry = volume.palette_index[:, :, k]
        part = np.where(tissue[entry], np.clip(deepest_mm - depth, 0.0, thickness), 0.0)
        below = depth + 0.5 * part - EPIDERMIS_MM
        ways = np.where(below > 0.0, 2.0, 1.0)
        left = passed * np.exp(-ways * added[entry] * part)
        light -= np.exp(-np.maximum(below, 0.0) / LIGHT_DEPTH_MM) * (passed - left)
        depth, passed = depth + part, left
        if np.all(depth >= deepest_mm):
            break
    return -np.log(np.maximum(light, 1e-6))


def _added_mu_a(volume: SkinVolume) -> np.ndarray:
    """Absorption of each palette entry less that of the clearest in its layer, where that is most, (P,) 1/mm."""
    first = int(np.argmin(np.abs(volume.wavelength_nm - REFERENCE_NM)))
    added = np.zeros(len(volume.palette_layer))
    for layer in np.unique(volume.palette_layer):
        entries = np.flatnonzero(volume.palette_layer == layer)
        mu_a = volume.mu_a[entries, first:]
        added[entries] = (mu_a - mu_a.min(axis=0)).max(axis=1)
    return added


def at_columns(values: np.ndarray, point: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """Values of columns (nx, ny) under points (Q, 2 or more), mm: (Q,)."""
    nx, ny = values.shape
    column = np.floor(point[:, 0] / size_mm[0] * nx).astype(int) % nx
    row = np.floor(point[:, 1] / size_mm[1] * ny).astype(int) % ny
    return values[column, row]


def is_alike(absorbance: np.ndarray) -> bool:
    """Whether columns differ so little that the kernel may be equally wide everywhere."""
    return bool(np.ptp(absorbance) <= ALIKE)


def in_pixels(radius_mm: float, spacing_mm: float) -> float:
    """A radius in pixels; the narrowest that a kernel may have at least."""
    return max(STEPS[0], radius_mm / spacing_mm)


def radius_levels(
    volume: SkinVolume,
    point: np.ndarray,
    shape: tuple[int, int],
    spacing_mm: float,
    widest_mm: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Radius of every pixel: (h, w) index into radii in pixels, and those radii.

    Parameters
    ----------
    point : (h w, 2) where the pixels' rays enter, mm.
    shape, spacing_mm : of the picture.
    widest_mm : the radius where nothing bounds it.
    """
    widest = in_pixels(widest_mm, spacing_mm)
    if is_alike(lesion_absorbance(volume, max(EPIDERMIS_MM, widest_mm))):
        return np.zeros(shape, np.int32), np.array([widest])
    radii = np.array([*(r for r in STEPS if r < widest), widest])
    level = np.zeros(shape, np.int32)
    alike = np.ones(shape, bool)
    for k, radius in enumerate(radii[1:], start=1):
        # light from deeper than a kernel is wide is blurred more by the tissue above
        absorbance = lesion_absorbance(volume, max(EPIDERMIS_MM, radius * spacing_mm))
        seen = at_columns(absorbance, point, volume.size_mm).reshape(shape).astype(np.float32)
        at_ray = correlate(seen, gaussian(radii[0]), wrap=True)
        alike &= np.abs(correlate(seen, gaussian(radius), wrap=True) - at_ray) <= ALIKE
        level[alike] = k
    return level, radii
