"""A stiff or extreme case: what is described, and what a run of it gives.

A case describes small scenes and how their outcomes are judged. Each scene goes the way of any other: volume, photon
pass, photon map, pictures by both estimates, EXR files.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.analysis.slab_walk import record_seed
from skinrender.engine.estimate import EstimateSummary, estimate
from skinrender.engine.summary import TraceSummary
from skinrender.engine.trace import MAP_NAME, trace
from skinrender.errors import InputError, RunError
from skinrender.film.exr import read_exr, write_exr
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.photon_map import PhotonMap, open_map
from skinrender.scene import Scene, make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import SkinVolume, load_volume, save_volume
from skinrender.transport import tally

METHODS = ("beam", "point")
STORED = 40_000
"""Photons that a case stores unless its scene says otherwise."""


@dataclass(frozen=True)
class Measure:
    """One number that was measured, and the largest that it may be."""

    quantity: str
    measured: float
    bound: float

    @property
    def ok(self) -> bool:
        return self.measured <= self.bound

    @property
    def share(self) -> float:
        """Part of the bound that is used up; infinite where it is passed or nothing is allowed."""
        if not self.ok:
            return np.inf
        return self.measured / self.bound if self.bound > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as it was read back from its EXR, with its summary."""

    image: SpectralImage
    summary: EstimateSummary


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a scene gave.

    Parameters
    ----------
    scene, volume : described and built.
    light : what became of the photons.
    photons : the map.
    pictures : by method.
    """

    scene: Scene
    volume: SkinVolume
    light: TraceSummary
    photons: PhotonMap
    pictures: Mapping[str, Picture]

    def count(self, column: int | slice) -> int:
        """Photons of all bands in some columns of `transport.tally`."""
        return int(self.light.counts[:, column].sum())


Judge = Callable[[Sequence[Outcome]], Iterable[Measure]]


@dataclass(frozen=True, eq=False)
class Case:
    """A stiff or extreme case.

    Parameters
    ----------
    name : as it is listed.
    could_break : what might go wrong.
    scenes : as scene files hold them; each gets a seed of its own unless it names one.
    judge : outcomes of the scenes -> what was measured; the invariants of `sound` are added.
    files : arrays (.npy) that the scenes name.
    """

    name: str
    could_break: str
    scenes: Sequence[Mapping[str, Any]]
    judge: Judge
    files: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Refused:
    """A case of scenes that must be refused with a message, and neither run nor fail otherwise.

    Parameters
    ----------
    told : what the message must name.
    """

    name: str
    could_break: str
    scenes: Sequence[Mapping[str, Any]]
    told: str


def measure(case: Case | Refused, seed: int) -> list[Measure]:
    """Run the scenes of a case and judge them."""
    with tempfile.TemporaryDirectory(prefix="skinrender-") as name:
        folder = Path(name)
        if isinstance(case, Refused):
            wrong = sum(not _is_refused(scene, case.told, folder) for scene in case.scenes)
            return [Measure("scenes not refused with a message", float(wrong), 0.0)]
        for file, values in case.files.items():
            np.save(folder / file, values)
        seeds = [record_seed(seed, case.name, side) for side in range(len(case.scenes))]
        try:
            outcomes = [run(scene, folder / str(k), seeds[k]) for k, scene in enumerate(case.scenes)]
        except (InputError, RunError) as error:
            return [Measure(f"failed: {error}".splitlines()[0], 1.0, 0.0)]
        return [*(found for outcome in outcomes for found in sound(outcome)), *case.judge(outcomes)]


def run(described: Mapping[str, Any], folder: Path, seed: int) -> Outcome:
    """Build, trace and estimate a scene in a new folder, whose parent holds the files that it names."""
    photons = {"stored": STORED, "seed": seed, **described.get("photons", {})}
    scene = make_scene({**described, "photons": photons}, source_dir=folder.parent)
    folder.mkdir()
    path = folder / "volume.npz"
    save_volume(build_volume(scene), path)
    light = trace(scene, path, folder, workers=1, progress=False)
    volume, photon_map = load_volume(path), open_map(folder / MAP_NAME, check_photons=True)
    pictures = {}
    for method in METHODS:
        image, summary = estimate(scene, volume, photon_map, method=method, threads=1, progress=False)
        write_exr(folder / "picture.exr", image, reflectance=True)
        pictures[method] = Picture(read_exr(folder / "picture.exr"), summary)
    return Outcome(scene, volume, light, photon_map, pictures)


def sound(outcome: Outcome) -> Iterable[Measure]:
    """What must hold in every case: the energy in counts, and numbers that can be radiances."""
    layers = len(outcome.light.layer_name)
    ends = [tally.REFLECTED, tally.TRANSMITTED, tally.SIDES, tally.absorbed(layers)]
    missing = abs(outcome.light.emitted - sum(outcome.count(end) for end in ends)) + outcome.light.lost
    yield Measure("photons unaccounted for", float(missing), 0.0)
    wrong = sum(_bad_values(picture.image) for picture in outcome.pictures.values())
    yield Measure("pixels not finite or negative", float(wrong), 0.0)


def _bad_values(image: SpectralImage) -> int:
    """Values that no radiance can have; R, G and B may be negative, outside the gamut."""
    parts = ("radiance", "surface_Y", "single_Y", "multiple_Y", "stderr_Y", "irradiance")
    values = [getattr(image, part) for part in parts]
    bad = sum(int(np.sum(~np.isfinite(value) | (value < 0.0))) for value in values)
    return bad + int(np.sum(~np.isfinite(image.rgb())) + np.sum(~np.isfinite(image.radiance_factor())))


def _is_refused(scene: Mapping[str, Any], told: str, folder: Path) -> bool:
    try:
        build_volume(make_scene(scene, source_dir=folder))
    except InputError as error:
        return told in str(error)
    return False
