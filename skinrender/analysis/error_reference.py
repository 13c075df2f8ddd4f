"""The picture that all others are held against: made once, in two independent halves, kept under its hash."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.analysis.compare import compare
from skinrender.analysis.error_bench import Bench, Shot, read_shot, write_shot
from skinrender.analysis.error_stats import (
    Uncertain,
    bias_of_mean,
    color_noise,
    reference_noise,
    relative_squared_error,
    squared_error,
)
from skinrender.analysis.error_study import Method, Subject
from skinrender.errors import InputError
from skinrender.film.spectral_image import SpectralImage

TIMES_LARGEST = {"beam": 4, "reference": 20}
"""Photons of the reference over those of the largest run; the one without kernels needs more."""
SEEDS = (0x5265666572656E63, 0x5265666572656E64)
"""Of the halves; no run has them."""


@dataclass(frozen=True, eq=False)
class ReferencePicture:
    """A reference with its own noise known.

    Parameters
    ----------
    identity : hash of scene, kind and program, and the photons.
    kind : ``beam`` or ``reference``.
    photons : stored for both halves together, as wanted.
    shots : the halves.
    """

    identity: str
    kind: str
    photons: int
    shots: tuple[Shot, Shot]

    @cached_property
    def halves(self) -> np.ndarray:
        """(2, h, w) luminance."""
        return np.stack([shot.image.y().astype(float) for shot in self.shots])

    @cached_property
    def image(self) -> SpectralImage:
        """Mean of the halves."""
        first, second = (shot.image for shot in self.shots)
        parts = ("radiance", "surface_Y", "single_Y", "multiple_Y")
        means = {name: 0.5 * (getattr(first, name) + getattr(second, name)) for name in parts}
        return replace(first, **means, stderr_Y=0.5 * np.hypot(first.stderr_Y, second.stderr_Y))

    @cached_property
    def mean(self) -> Uncertain:
        """Mean luminance."""
        first, second = (shot.mean for shot in self.shots)
        return Uncertain(0.5 * (first.value + second.value), 0.5 * math.hypot(first.stderr, second.stderr))

    @property
    def noise(self) -> float:
        """See `error_stats.reference_noise`."""
        return reference_noise(self.halves)

    @cached_property
    def color_noise(self) -> float:
        """Mean CIEDE2000 between this picture and one without noise, as its halves tell."""
        return color_noise(np.stack([shot.image.lab() for shot in self.shots])) / math.sqrt(2.0)


def kind_of_reference(subject: Subject, wanted: str | None) -> tuple[str, str]:
    """Which estimate makes the reference, and why."""
    if wanted is not None:
        return wanted, "asked for"
    if subject.scene.relief.kind != "flat":
        return "beam", "under a relief a photon takes the exact connection a hundred times as long"
    if len(subject.scene.wavelength_nm) > 1:
        return "beam", "without any kernel the colors of many bands would be too noisy"
    return "reference", "a flat surface and one band: exact connections without any kernel are affordable"


def find_reference(folder: Path, subject: Subject, kind: str, program: str, least: int) -> ReferencePicture | None:
    """The largest reference that is there, if it has at least so many photons."""
    key = _key(subject, kind, program)
    counts = sorted(
        (int(path.stem.split("_")[1]) for path in folder.glob(f"{key}_*_0.exr") if path.stem.split("_")[1].isdecimal()),
        reverse=True,
    )
    for photons in counts:
        if photons < least:
            return None
        shots = [_half(folder, key, photons, half) for half in range(2)]
        if None not in shots:
            return ReferencePicture(f"{key}_{photons}", kind, photons, tuple(shots))
    return None


def make_reference(folder: Path, bench: Bench, kind: str, program: str, photons: int) -> ReferencePicture:
    """Make the halves that are missing; what a killed run has traced is gone on from."""
    key = _key(bench.subject, kind, program)
    shots = []
    for half, seed in enumerate(SEEDS):
        shot = _half(folder, key, photons, half)
        if shot is None:
            with bench.traced(max(1, photons // 2), seed, resume=True) as traced:
                shot = bench.shoot(traced.photon_map, Method(kind))
            write_shot(shot, _path(folder, key, photons, half), {"stage": "report", "hash": bench.subject.identity})
        shots.append(shot)
    return ReferencePicture(f"{key}_{photons}", kind, photons, tuple(shots))


def errors_of(shot: Shot, reference: ReferencePicture, total_s: float) -> dict[str, Any]:
    """Columns of a row that depend on the reference, and what the picture claims."""
    y = shot.image.y().astype(float)
    told = compare(shot.image, reference.image)
    square, relative = squared_error(y, reference.halves), relative_squared_error(y, reference.halves)
    bias = bias_of_mean([shot.mean], reference.mean)
    return {
        "reference": reference.identity,
        "rmse": math.sqrt(square.value) if square.value > 0 else math.nan,
        "relmse": relative.value,
        "relmse_stderr": relative.stderr,
        "relmse_uncorrected": _or_nan(told["relmse"]),
        "bias": bias.value,
        "bias_stderr": bias.stderr,
        "delta_e_mean": told["delta_e_mean"],
        "delta_e_p95": told["delta_e_p95"],
        "ssim": _or_nan(told["ssim"]),
        "stderr_relative_mean": shot.stderr_relative,
        "mean_stderr_relative": shot.mean.stderr / shot.mean.value if shot.mean.value else math.nan,
        "efficiency_per_s": 1.0 / (relative.value * total_s) if relative.value > 0 else math.nan,
    }


def _key(subject: Subject, kind: str, program: str) -> str:
    return hashlib.sha256(f"{subject.identity} {kind} {program}".encode()).hexdigest()[:12]


def _path(folder: Path, key: str, photons: int, half: int) -> Path:
    return folder / f"{key}_{photons}_{half}.exr"


def _half(folder: Path, key: str, photons: int, half: int) -> Shot | None:
    path = _path(folder, key, photons, half)
    if not path.is_file():
        return None
    try:
        return read_shot(path)
    except InputError:
        return None


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
