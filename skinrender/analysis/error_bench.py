"""A scene on the bench: photons traced into a temporary map, pictures taken of it, every stage timed."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skinrender.analysis.error_stats import Uncertain
from skinrender.analysis.error_study import Method, Subject
from skinrender.engine.clock import StageClock
from skinrender.engine.estimate import open_view, relative_stderr
from skinrender.engine.summary import TraceSummary
from skinrender.engine.trace import trace
from skinrender.errors import InputError
from skinrender.estimate.scatter_image import batch_stderr
from skinrender.film.exr import read_exr, write_exr
from skinrender.film.png import write_png
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.photon_map import PhotonMap, open_map
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import load_volume, save_volume

WARM_UP_PHOTONS = 2000
_SUMMARY = "summary"


@dataclass(frozen=True, eq=False)
class Traced:
    """A photon map that exists for the moment, its summary, and the seconds it took."""

    photon_map: PhotonMap
    summary: TraceSummary
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture with what it claims about its noise.

    Parameters
    ----------
    mean : luminance of the whole picture, with its standard error from the batches of rounds.
    stderr_relative : mean over the lit pixels of the claimed standard error over the luminance; nan = unknown.
    """

    image: SpectralImage
    mean: Uncertain
    stderr_relative: float


class Bench:
    """A scene's volume in a folder for temporary files.

    Parameters
    ----------
    subject : the scene.
    folder : made; `clear` removes what is temporary in it.
    workers, progress : of the photon pass and the estimate.
    """

    def __init__(self, subject: Subject, folder: Path, workers: int | None, progress: bool) -> None:
        self.subject, self.folder, self.workers, self.progress = subject, folder, workers, progress
        folder.mkdir(parents=True, exist_ok=True)
        self.clear()
        clock = StageClock()
        with clock.stage("load"):
            save_volume(build_volume(subject.scene), self._volume_path)
            self.volume = load_volume(self._volume_path)
        self.load_seconds = clock.seconds["load"]

    @property
    def _volume_path(self) -> Path:
        return self.folder / "volume.npz"

    @property
    def _passing(self) -> Path:
        return self.folder / "passing"

    @contextmanager
    def traced(self, photons: int, seed: int, *, resume: bool = False) -> Iterator[Traced]:
        """Trace, and delete the map after use.

        Parameters
        ----------
        resume : go on from what a killed run has left, and leave it for the next one. Not where seconds are measured.
        """
        folder, clock = (self.folder if resume else self._passing) / f"{photons}_{seed}", StageClock()
        try:
            scene = self.subject.scene_of(photons, seed)
            summary = trace(
                scene, self._volume_path, folder, workers=self.workers, resume=resume, progress=self.progress, clock=clock
            )
            with clock.stage("load"):
                photon_map = open_map(folder / "photons.npz")
            yield Traced(photon_map, summary, clock.seconds)
            shutil.rmtree(folder)
        finally:
            if not resume:
                shutil.rmtree(folder, ignore_errors=True)

    def shoot(self, photon_map: PhotonMap, method: Method, clock: StageClock | None = None) -> Shot:
        """Estimate the picture, timed as the stage ``estimate``."""
        with (clock or StageClock()).stage("estimate"):
            view = open_view(
                self.subject.scene, self.volume, photon_map.rounds,
                method=method.name, gather_count=method.gather_count, threads=self.workers,
            )  # fmt: skip
            scattered = view.scattered(photon_map, self.progress)
            image = view.image(scattered, {"photon_map": dict(photon_map.provenance)})
        of_batches = scattered.batch_y.mean(axis=(1, 2), dtype=np.float64)
        error = float(batch_stderr(of_batches, scattered.batch_rounds))
        noise = relative_stderr(image)
        return Shot(image, Uncertain(float(image.y().mean()), error), math.nan if noise is None else noise)

    def warm_up(self, methods: tuple[Method, ...]) -> None:
        """Load or compile the kernels, so that no timed run has to."""
        with self.traced(WARM_UP_PHOTONS, self.subject.scene.photons.seed) as traced:
            for method in methods:
                self.shoot(traced.photon_map, method)

    def clear(self) -> None:
        """Remove the maps of runs, but not what an interrupted reference has left."""
        shutil.rmtree(self._passing, ignore_errors=True)


def write_shot(shot: Shot, path: Path, told: dict, clock: StageClock | None = None) -> None:
    """Write EXR and PNG, timed as the stage ``write``; `told` enters the provenance."""
    noise = {
        "mean_luminance": {"value": shot.mean.value, "stderr": _or_none(shot.mean.stderr)},
        "stderr_relative_mean": _or_none(shot.stderr_relative),
    }
    with (clock or StageClock()).stage("write"):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_png(path.with_suffix(".png"), shot.image.display_rgb())
        write_exr(path, replace(shot.image, provenance=shot.image.provenance | told | {_SUMMARY: noise}))


def read_shot(path: Path) -> Shot:
    """A picture of `write_shot`; raises `InputError` if it is not one."""
    image = read_exr(path)
    try:
        noise = image.provenance[_SUMMARY]
        mean = noise["mean_luminance"]
        return Shot(image, Uncertain(mean["value"], _or_nan(mean["stderr"])), _or_nan(noise["stderr_relative_mean"]))
    except (KeyError, TypeError):
        raise InputError("is not a picture of a report", where=str(path), remedy="delete it; it is made again") from None


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
