"""How deep the light has been that comes back from skin, by wavelength.

Skin that is perfectly black below a depth returns the light that has never been deeper. The share of it in the light
that whole skin returns is the distribution of the greatest depth on its way. Light at the surface's own reflection is
left out: it has been nowhere.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.analysis.spectrum import spectrum
from skinrender.atomic import whole_file
from skinrender.scene import Scene
from skinrender.skin.builder import scene_layers
from skinrender.skin.dermis import dermis_mm

BELOW_MM = (0.0, 0.03, 0.07, 0.12, 0.2, 0.3, 0.45, 0.65, 0.9, 1.2)
"""Depths below the top of the dermis from which the skin is made black."""
QUANTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class LightDepth:
    """Greatest depth of the light that comes back; B bands.

    Parameters
    ----------
    wavelength_nm : (B,).
    depth_mm : (D,) below the surface, 0 first.
    share : (D, B) of the light that has been no deeper, with standard error ``share_stderr``.
    """

    wavelength_nm: np.ndarray
    depth_mm: np.ndarray
    share: np.ndarray
    share_stderr: np.ndarray

    @property
    def mean_mm(self) -> np.ndarray:
        """Mean greatest depth (B,); light from below the last depth counts as from there."""
        return np.trapezoid(1.0 - self.share, self.depth_mm, axis=0)

    def quantile_mm(self, share: float) -> np.ndarray:
        """Depth (B,) that the share of the light has not passed; the last depth where more has passed it."""
        rising = np.maximum.accumulate(self.share, axis=0)
        return np.array([np.interp(share, of_band, self.depth_mm) for of_band in rising.T])


def light_depth(scene_with: Callable[..., Scene], stderr: float) -> LightDepth:
    """Walk skin that is black below each depth.

    Parameters
    ----------
    scene_with : makes the scene from keys of lesions, all of it covered by them.
    stderr : relative standard error of the reflectances; half of it where the whole skin serves for all.
    """
    plain = scene_with()
    top_mm, bottom_mm = dermis_mm(scene_layers(plain))
    whole = spectrum(plain, stderr=stderr / 2).patch
    share, error = [np.zeros_like(whole.diffuse)], [np.zeros_like(whole.diffuse)]
    for number, depth_mm in enumerate(BELOW_MM, 2):
        found = spectrum(scene_with(_black(depth_mm, bottom_mm - top_mm)), stderr=stderr, seed=number).patch
        share.append(found.diffuse / whole.diffuse)
        error.append(np.hypot(found.diffuse_stderr, share[-1] * whole.diffuse_stderr) / whole.diffuse)
    depths = np.array([0.0, *(top_mm + depth_mm for depth_mm in BELOW_MM)])
    return LightDepth(np.array(plain.wavelength_nm), depths, np.array(share), np.array(error))


def write_light_depth(found: LightDepth, path: Path) -> None:
    """CSV: a line for each wavelength; mean, quantiles, and the share by depth."""
    with whole_file(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        quantiles = [f"depth_{100 * q:.0f}_percent_mm" for q in QUANTILES]
        shares = [f"share_to_{depth:.3f}_mm" for depth in found.depth_mm[1:]]
        writer.writerow(["wavelength_nm", "mean_depth_mm", *quantiles, *shares])
        columns = [found.mean_mm, *(found.quantile_mm(q) for q in QUANTILES), *found.share[1:]]
        for nm, *numbers in zip(found.wavelength_nm, *columns):
            writer.writerow([f"{nm:g}", *(f"{value:.4g}" for value in numbers)])


def _black(depth_mm: float, bottom_mm: float) -> Mapping[str, Any]:
    return {"kind": "tattoo", "ink": "carbon_black", "volume_fraction": 1.0, "depth_mm": [depth_mm, bottom_mm]}
