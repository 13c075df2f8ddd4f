"""Short timed runs of each stage on this machine, from which a plan extrapolates."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from skinrender.engine.estimate import estimate
from skinrender.npz import write_npz
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.photonmap.photon_pass import PhotonPass, Round
from skinrender.skin.volume import SkinVolume

Result = TypeVar("Result")

ENOUGH_SECONDS = 0.25
FIRST_HISTORIES = 2048
WRITTEN_BYTES = 1 << 24
MOST_LOADING_SECONDS = 1.0
FEWEST_ROUNDS = 2
"""A standard error needs two."""
FEW_PIXELS, MORE_PIXELS = 16, 40
"""Along the longer side of the picture."""
MORE_PHOTONS = 3e6


@dataclass(frozen=True)
class Linear:
    """Seconds that grow with a size: start + each * size."""

    start: float
    each: float

    def at(self, size: float) -> float:
        """Seconds for a size."""
        return self.start + self.each * size


@dataclass(frozen=True)
class EstimateRate:
    """Seconds of an estimate: start + by_pixel * pixels + by_photon * photons."""

    start: float
    by_pixel: float
    by_photon: float

    def at(self, pixels: float, photons: float) -> float:
        """Seconds for a picture and a map."""
        return self.start + self.by_pixel * pixels + self.by_photon * photons


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds of a call, and what it gave."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def loading_seconds(first: float, again: float) -> float:
    """What a first run takes longer because it loads kernels; when it compiled them, as much as loading may take."""
    return min(max(0.0, first - again), MOST_LOADING_SECONDS)


def time_walk(photon_pass: PhotonPass, histories: np.ndarray) -> tuple[float, Round]:
    """Seconds per history of rounds like that of a run, and the last round walked.

    Parameters
    ----------
    photon_pass : whose bands are prepared.
    histories : (B,) of a round; as small a share of them is walked as gives a time worth having.
    """
    share = min(1.0, FIRST_HISTORIES / histories.sum())
    while True:
        some = np.ceil(share * histories).astype(np.int64)
        seconds, walked = timed(lambda some=some: photon_pass.walk(0, some, True))
        if share == 1.0 or seconds >= ENOUGH_SECONDS:
            return seconds / some.sum(), walked
        share = min(1.0, 4.0 * share)


def time_writing() -> Linear:
    """Seconds of a file by its bytes, in the folder for temporary files."""
    with tempfile.TemporaryDirectory(prefix="skinrender-plan-") as folder:
        small, _ = timed(lambda: write_npz(Path(folder) / "small.npz", {"a": np.zeros(1)}))
        large, _ = timed(lambda: write_npz(Path(folder) / "large.npz", {"a": np.zeros(WRITTEN_BYTES, np.uint8)}))
    return Linear(small, max(0.0, large - small) / WRITTEN_BYTES)


def time_estimate(scene: Any, volume: SkinVolume, photon_pass: PhotonPass, walked: Round) -> tuple[EstimateRate, Any]:
    """Rates of the scene's estimate, and a piece of its picture.

    A small window at the picture's own resolution gives the seconds by pixel; the whole window in few pixels, in which
    every photon is seen, those by photon.
    """
    few, many = round_as_map(photon_pass, walked, 1), round_as_map(photon_pass, walked, _repeats(len(walked.position)))
    piece, larger = _cropped(scene, volume, FEW_PIXELS), _cropped(scene, volume, MORE_PIXELS)
    whole = _coarse(scene, MORE_PIXELS)

    def seconds(of: Any, photon_map: PhotonMap) -> float:
        return timed(lambda: estimate(of, volume, photon_map, progress=False))[0]

    first = seconds(piece, few)
    with_few, with_more = seconds(piece, few), seconds(larger, few)
    pixels = math.prod(piece.camera.pixels)
    by_pixel = _slope(with_few, with_more, math.prod(larger.camera.pixels) - pixels)
    by_photon = _slope(seconds(whole, few), seconds(whole, many), len(many) - len(few))
    start = max(0.0, with_few - by_pixel * pixels - by_photon * len(few))
    start += loading_seconds(first, with_few)
    return EstimateRate(start, by_pixel, by_photon), estimate(larger, volume, few, progress=False)[0]


def round_as_map(photon_pass: PhotonPass, walked: Round, repeats: int) -> PhotonMap:
    """A map in memory that holds the photons of one round, `repeats` times in two rounds or more."""
    return map_from_rounds(photon_pass, [walked] * (FEWEST_ROUNDS * repeats))


def _repeats(photons: int) -> int:
    return max(2, math.ceil(MORE_PHOTONS / (FEWEST_ROUNDS * max(1, photons))))


def _slope(low: float, high: float, steps: int) -> float:
    return max(0.0, high - low) / steps if steps > 0 else 0.0


def _pixels(scene: Any, longest: int) -> tuple[int, int]:
    """The picture's pixels, at most `longest` on a side, of about its aspect."""
    share = min(1.0, longest / max(scene.camera.pixels))
    return tuple(max(1, round(share * count)) for count in scene.camera.pixels)


def _coarse(scene: Any, longest: int) -> Any:
    """The scene in fewer pixels."""
    return scene.model_copy(update={"camera": scene.camera.model_copy(update={"pixels": _pixels(scene, longest)})})


def _cropped(scene: Any, volume: SkinVolume, longest: int) -> Any:
    """The scene's picture cut to fewer pixels of the same size."""
    window, pixels = scene.camera.window_mm or volume.size_mm, _pixels(scene, longest)
    window = tuple(length * few / count for length, few, count in zip(window, pixels, scene.camera.pixels))
    return scene.model_copy(update={"camera": scene.camera.model_copy(update={"pixels": pixels, "window_mm": window})})
