"""How a photon pass is made, in a form small enough to be sent to every worker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from skinrender.engine.identity import file_hash
from skinrender.errors import InputError


class Recipe(Protocol):
    """Picklable instructions for a photon pass."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """What determines its photons, apart from the seed; JSON."""

    def build(self, seed: int) -> Any:
        """A `photon_pass.PhotonPass`."""

    def describe(self, photon_pass: Any) -> dict[str, Any]:
        """Members of `store.MapHeader` that follow from a pass: all but provenance and the number of photons."""


@dataclass(frozen=True, eq=False)
class HeldRecipe:
    """The photon pass in a volume that is at hand but not in a file, so that no worker can be sent there: for plans.

    Parameters
    ----------
    volume : a `skin.volume.SkinVolume`.
    light, roulette : see `VolumeRecipe`.
    """

    volume: Any
    light: Any
    roulette: bool

    @property
    def provenance(self) -> Mapping[str, Any]:
        # as long as a file's hash, for the bytes that a plan predicts, and another for another volume
        return _provenance(f"{id(self.volume):064x}", self.light, self.roulette)

    def build(self, seed: int) -> Any:
        from skinrender.photonmap.photon_pass import PhotonPass

        return PhotonPass(self.volume, self.light, seed, roulette=self.roulette).prepare()

    def describe(self, photon_pass: Any) -> dict[str, Any]:
        return _described(photon_pass)


@dataclass(frozen=True)
class VolumeFile:
    """A ``volume.npz``, and its bytes' SHA-256."""

    path: Path
    digest: str


@dataclass(frozen=True, eq=False)
class VolumeRecipe:
    """The photon pass in a volume that lies in a file.

    Parameters
    ----------
    volume_path : the ``volume.npz``.
    light : a `photonmap.light.Light`.
    roulette : thin out photons that no view ray can see.
    """

    volume_path: Path
    light: Any
    roulette: bool

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        return _provenance(file_hash(self.volume_path), self.light, self.roulette)

    @property
    def volume_file(self) -> VolumeFile:
        """The volume's file."""
        return VolumeFile(self.volume_path, self.provenance["volume"])

    def build(self, seed: int) -> Any:
        from skinrender.photonmap.photon_pass import PhotonPass
        from skinrender.skin.volume import load_volume

        return PhotonPass(load_volume(self.volume_path), self.light, seed, roulette=self.roulette).prepare()

    def describe(self, photon_pass: Any) -> dict[str, Any]:
        return _described(photon_pass)


def _provenance(volume_hash: str, light: Any, roulette: bool) -> Mapping[str, Any]:
    lamp = {field.name: getattr(light, field.name) for field in fields(light)}
    lamp = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in lamp.items()}
    return {"volume": volume_hash, "light": {"kind": type(light).__name__, **lamp}, "roulette": roulette}


def _described(photon_pass: Any) -> dict[str, Any]:
    return {
        "wavelength_nm": photon_pass.volume.wavelength_nm,
        "power_aimed_per_band": photon_pass.power_per_band_aimed,
        "bounds_mm": photon_pass.volume.bounds_mm,
        "layer_name": tuple(photon_pass.layer_names),
        "keep_probability": photon_pass.depth_table.keep_probability,
        "depth_edges_mm": photon_pass.depth_table.depth_edges_mm,
    }


def scene_recipe(scene: Any, volume_path: str | Path) -> VolumeRecipe:
    """The photon pass of a scene in its volume; camera, film and estimate are not read.

    Raises `InputError` if there is no volume yet, or one of other bands.
    """
    from skinrender.photonmap.light import light_from_scene
    from skinrender.skin.volume import load_volume

    volume_path = Path(volume_path).absolute()
    if not volume_path.is_file():
        raise InputError("there is no volume", where=str(volume_path), remedy="run `skinrender build` first")
    if not np.array_equal(load_volume(volume_path).wavelength_nm, scene.wavelength_nm):
        raise InputError(
            "the volume has other wavelength bands than the scene",
            where=str(volume_path),
            remedy="run `skinrender build` again",
        )
    return VolumeRecipe(volume_path, light_from_scene(scene), scene.photons.roulette)
