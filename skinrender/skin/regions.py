"""Regions: the tissue between two borders at which light is refracted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinrender.skin.volume import SkinVolume

LIGHT_DEPTH_MM = 0.5
"""Depth over which the light that comes back falls; weights the indices of layers that share a region."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Borders with Fresnel reflection, from the surface down, and the R regions between them.

    Parameters
    ----------
    first_layer : (R,) uppermost tissue layer of each region, 0 = the topmost.
    border_z_mm : (R + 1,) mean z of the surface, the inner borders and the bottom.
    heights_mm : R + 1 control-point fields (hx, hy), None where a border is flat.
    index : (R + 2, B) refractive indices: outside, the regions, below.
    """

    first_layer: np.ndarray
    border_z_mm: np.ndarray
    heights_mm: tuple[np.ndarray | None, ...]
    index: np.ndarray

    @property
    def count(self) -> int:
        return len(self.first_layer)

    @property
    def surface_refracts(self) -> bool:
        """Whether the surface reflects and refracts in any band."""
        return bool(np.any(self.index[0] != self.index[1]))

    @property
    def disperses(self) -> bool:
        """Whether any index depends on the wavelength."""
        return bool(np.any(self.index != self.index[:, :1]))


def regions_of(volume: SkinVolume) -> Regions:
    """The regions of a volume.

    Layers whose common border has no Fresnel share a region and one index, the mean of theirs weighted by the light
    that reaches them (Cauchy indices of Ding et al. 2006 give about 1.39 for skin). Taking the thin stratum corneum's
    1.5 instead would raise the internal reflectance of diffuse light from 0.5 to 0.6.
    """
    tissues = len(volume.layer_name) - 1
    first = np.array([0, *(k + 1 for k in volume.fresnel_borders)])
    ends = np.append(first[1:], tissues)
    z = volume.border_z_mm
    # share of the light between two depths; a region's own top counts from there, so that deep ones have a mean too
    index = [volume.n_outside]
    for top, end in zip(first, ends):
        reach = np.exp(-(z[top : end + 1] - z[top]) / LIGHT_DEPTH_MM)
        weight = reach[:-1] - reach[1:]
        n = volume.refractive_index[1 + top : 1 + end]
        index.append(n[0] + weight @ (n - n[0]) / weight.sum())  # of equal indices exactly theirs
    index.append(volume.n_below)
    heights = [volume.surface_mm]
    for top in first[1:]:
        heights.append(None if volume.border_mm is None else volume.border_mm[top - 1])
    heights.append(None)
    return Regions(first, z[np.append(first, tissues)], tuple(heights), np.array(index))
