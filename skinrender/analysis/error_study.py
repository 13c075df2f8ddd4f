"""What a report on error against run time compares: scenes, methods, photon counts, seeds."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinrender.engine.clock import cpu_name
from skinrender.engine.identity import ESTIMATE_SOURCES, machine_identity, program_identity
from skinrender.engine.view import METHODS
from skinrender.errors import InputError
from skinrender.scene import BUILD_PARTS, scene_hash
from skinrender.sources import sources_hash

PICTURE_PARTS = (
    *BUILD_PARTS, "light", "photons.roulette", "camera", "finish", "estimate.gather_count", "estimate.subpixels"
)  # fmt: skip
DECADES = 3
FEWEST_PHOTONS = 100


@dataclass(frozen=True)
class Method:
    """A radiance estimate as it is compared.

    Parameters
    ----------
    name : one of `view.METHODS`.
    gather_count : photons that a beam or sample point meets; None: as the scene says.
    """

    name: str
    gather_count: int | None = None

    @property
    def label(self) -> str:
        """For people and legends."""
        return self.name if self.gather_count is None else f"{self.name}, K = {self.gather_count}"

    @classmethod
    def parse(cls, text: str) -> Method:
        """``beam``, or ``beam:5000`` with a gather count; raises `InputError`."""
        name, colon, count = text.partition(":")
        if name not in METHODS or colon and (name == "reference" or not _is_count(count)):
            raise InputError(
                f"got {text!r}", where="--method",
                remedy=f"write {', '.join(METHODS)}, or beam:5000, point:5000 with a gather count from 1 to 1e9",
            )  # fmt: skip
        return cls(name, int(float(count)) if colon else None)


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene that is reported on.

    Parameters
    ----------
    scene : checked.
    label : its name, made unique.
    path : its file as the user wrote it.
    identity : hash of all that a picture depends on, but method, photons and seed.
    """

    scene: Any
    label: str
    path: Path
    identity: str

    def scene_of(self, photons: int, seed: int) -> Any:
        """The scene with so many stored photons of that seed."""
        changed = self.scene.photons.model_copy(update={"stored": photons, "seed": seed})
        return self.scene.model_copy(update={"photons": changed})


@dataclass(frozen=True, eq=False)
class Study:
    """A whole report.

    Parameters
    ----------
    subjects, methods : compared.
    counts : photons stored, ascending; None: per scene, `DECADES` decades up to its own number.
    seeds : how many of each.
    reference : ``beam``, ``reference``, or None: see `error_reference.kind_of_reference`.
    reference_photons : stored by both halves together; None: a multiple of the largest count.
    workers : processes and threads; None: what each run is worth.
    target_seconds : for all that is still to be run.
    """

    subjects: tuple[Subject, ...]
    methods: tuple[Method, ...] = (Method("beam"), Method("point"))
    counts: tuple[int, ...] | None = None
    seeds: int = 3
    reference: str | None = None
    reference_photons: int | None = None
    workers: int | None = None
    target_seconds: float | None = None

    def counts_of(self, subject: Subject) -> tuple[int, ...]:
        """Photon counts of a scene, ascending."""
        if self.counts is not None:
            return tuple(sorted(set(self.counts)))
        most = subject.scene.photons.stored
        counts = {max(min(FEWEST_PHOTONS, most), round(most / 10**decade)) for decade in range(DECADES + 1)}
        return tuple(sorted(counts))

    def seeds_of(self, subject: Subject) -> tuple[int, ...]:
        """Seeds of a scene, from its own on."""
        return tuple((subject.scene.photons.seed + k) % 2**63 for k in range(self.seeds))


def make_subjects(scenes: Iterable[tuple[Any, Path]]) -> tuple[Subject, ...]:
    """Scenes with their paths, under labels that are unique; raises `InputError` where a scene stands twice."""
    subjects: list[Subject] = []
    for scene, path in scenes:
        identity = scene_hash(scene, PICTURE_PARTS)[:16]
        if any(other.identity == identity for other in subjects):
            raise InputError("this scene stands twice in the command", where=str(path), remedy="name it once")
        taken = any(other.label == scene.name for other in subjects)
        subjects.append(Subject(scene, f"{scene.name} ({identity[:6]})" if taken else scene.name, path, identity))
    return tuple(subjects)


def count_text(photons: float) -> str:
    """A number of photons as people write it: 1e7."""
    return f"{photons:.2g}".replace("e+0", "e").replace("e+", "e")


def _is_count(text: str) -> bool:
    try:
        number = float(text)
    except ValueError:
        return False
    return 1 <= number <= 1e9 and number.is_integer()


def program_hash() -> str:
    """Fingerprint of what decides pictures besides the scene: sources and libraries."""
    return _hash([program_identity(), sources_hash(ESTIMATE_SOURCES)])


def bench_hash(workers: int | None) -> str:
    """Fingerprint of what decides pictures and seconds besides the scene: program, machine, workers."""
    return _hash([program_hash(), machine_identity(), cpu_name(), os.cpu_count(), workers])


def _hash(told: list[Any]) -> str:
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
