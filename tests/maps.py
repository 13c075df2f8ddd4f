"""Photon maps and pictures of small scenes, made in memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skinrender.engine.estimate import EstimateSummary, estimate
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.light import Light, light_from_scene
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import Scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import SkinVolume

W_PER_MM2 = 1e-6
"""W mm^-2 sr^-1 of one unit of a one-band picture's luminance, which is in W m^-2 sr^-1."""


class Lit(NamedTuple):
    """A scene with its volume and photons."""

    scene: Scene
    volume: SkinVolume
    photons: PhotonMap


def make_map(
    volume: SkinVolume, light: Light, histories: int, rounds: int = 20, seed: int = 1, roulette: bool = True
) -> PhotonMap:
    """Photons of some rounds of so many histories in every band."""
    photon_pass = PhotonPass(volume, light, seed, roulette=roulette)
    per_band = np.full(photon_pass.bands, histories)
    return map_from_rounds(photon_pass, [photon_pass.walk(index, per_band, True) for index in range(rounds)])


def light_up(data: dict[str, Any], histories: int, rounds: int = 20, seed: int = 1) -> Lit:
    """Scene, volume and photons of a scene given as plain data."""
    scene = make_scene(data)
    volume = build_volume(scene)
    return Lit(scene, volume, make_map(volume, light_from_scene(scene), histories, rounds, seed))


def see(lit: Lit, method: str = "beam", camera: dict | None = None, **options) -> tuple[SpectralImage, EstimateSummary]:
    """Picture of a scene by its own camera, or by that with some entries changed."""
    scene = lit.scene
    if camera is not None:
        scene = scene.model_copy(update={"camera": scene.camera.model_copy(update=camera)})
    return estimate(scene, lit.volume, lit.photons, method=method, progress=False, **options)


def slab_data(layers: Sequence[dict[str, float]], light: dict[str, Any], size_mm: float = 0.5, pixels: int = 8) -> dict:
    """A one-band slab in air, periodic, seen from above without reflection by its surface."""
    return {
        "patch": {"size_mm": [size_mm, size_mm], "columns": [1, 1]},
        "bands_nm": [550],
        "slab": {"layers": list(layers)},
        "below": {"refractive_index": 1.0},
        "light": {"spectrum": "E", **light},
        "camera": {"pixels": [pixels, pixels], "cross_polarized": True},
    }


def slab_layer(thickness_mm: float, mu_a: float, mu_s: float, g: float, n: float) -> dict[str, float]:
    """A layer of `slab_data`."""
    return {
        "thickness_mm": thickness_mm, "mu_a_per_mm": mu_a, "mu_s_per_mm": mu_s, "g": g, "refractive_index": n,
    }  # fmt: skip
