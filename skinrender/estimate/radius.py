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
"""Largest difference between the kernel's mean of the epidermis' added vertical absorbance and its value at the ray."""
EPIDERMIS_MM = 0.15
REFERENCE_NM = 450.0
STEPS = (1.5, 2.2, 3.2, 4.6, 6.8, 10.0, 15.0, 22.0, 32.0)
"""Radii in pixels that a bounded kernel may take. Narrower ones, where a pattern is noisy, only add speckle."""


def gather_radius_mm(gather_count: int | None, photons: int, size_mm: tuple[float, float]) -> float:
    """Radius at which a beam meets `gather_count` of the photons under the patch; `WIDEST_MM` at most and for None."""
    if gather_count is None:
        return WIDEST_MM
    per_area = photons / (size_mm[0] * size_mm[1])
    return min(WIDEST_MM, math.sqrt(gather_count / (math.pi * max(per_area, 1e-12))))


def lesion_absorbance(volume: SkinVolume) -> np.ndarray:
    """Vertical absorbance by column, (nx, ny), that lesions add within `EPIDERMIS_MM` of the surface, at 450 nm."""
    band = int(np.argmin(np.abs(volume.wavelength_nm - REFERENCE_NM)))
    added = np.zeros(len(volume.palette_layer))
    for layer in np.unique(volume.palette_layer):
        entries = np.flatnonzero(volume.palette_layer == layer)
        added[entries] = volume.mu_a[entries, band] - volume.mu_a[entries, band].min()
    tissue = volume.palette_layer > 0
    total = np.zeros(volume.shape[:2])
    depth = np.zeros(volume.shape[:2])
    for k, thickness in enumerate(np.diff(volume.z_edges_mm)):
        entry = volume.palette_index[:, :, k]
        part = np.where(tissue[entry], np.clip(EPIDERMIS_MM - depth, 0.0, thickness), 0.0)
        total += added[entry] * part
        depth += part
        if np.all(depth >= EPIDERMIS_MM):
            break
    return total


def radius_levels(
    volume: SkinVolume, point: np.ndarray, shape: tuple[int, int], spacing_mm: float, widest_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Radius of every pixel: (h, w) index into radii in pixels, and those radii.

    Parameters
    ----------
    point : (h w, 2) where the pixels' rays enter, mm.
    shape, spacing_mm : of the picture.
    widest_mm : the radius where nothing bounds it.
    """
    widest = max(STEPS[0], widest_mm / spacing_mm)
    absorbance = lesion_absorbance(volume)
    if np.ptp(absorbance) <= ALIKE:
        return np.zeros(shape, np.int32), np.array([widest])
    radii = np.array([*(r for r in STEPS if r < widest), widest])
    nx, ny = volume.shape[:2]
    columns = np.floor(point[:, 0] / volume.size_mm[0] * nx).astype(int) % nx
    rows = np.floor(point[:, 1] / volume.size_mm[1] * ny).astype(int) % ny
    seen = absorbance[columns, rows].reshape(shape).astype(np.float32)
    at_ray = correlate(seen, gaussian(radii[0]), wrap=True)
    level = np.zeros(shape, np.int32)
    alike = np.ones(shape, bool)
    for k, radius in enumerate(radii[1:], start=1):
        alike &= np.abs(correlate(seen, gaussian(radius), wrap=True) - at_ray) <= ALIKE
        level[alike] = k
    return level, radii
