"""What a report shows of one scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from skinrender.analysis.error_bench import read_shot
from skinrender.analysis.error_levels import Series, make_level, make_series
from skinrender.analysis.error_reference import ReferencePicture
from skinrender.analysis.error_rows import ErrorRow
from skinrender.analysis.error_runs import Outcome
from skinrender.analysis.error_study import Method, Study, Subject
from skinrender.film.spectral_image import SpectralImage


@dataclass(frozen=True, eq=False)
class Shown:
    """A picture as it is shown.

    Parameters
    ----------
    difference : (h, w), (A - R) / R; nan where R is not above 0.
    """

    series: Series
    row: ErrorRow
    image: SpectralImage
    difference: np.ndarray

    @property
    def rms(self) -> float:
        """Root of the relMSE; nan where it came out negative."""
        return math.sqrt(self.row.relmse) if self.row.relmse > 0 else math.nan


@dataclass(frozen=True, eq=False)
class Findings:
    """One scene.

    Parameters
    ----------
    reference, why : the reference, and why it is of its kind.
    series : one a method that was run, in the order asked for.
    folder : that the pictures of the rows are relative to.
    """

    subject: Subject
    reference: ReferencePicture
    why: str
    series: tuple[Series, ...]
    folder: Path

    @cached_property
    def shown(self) -> tuple[Shown, ...]:
        """A picture of each method at nearly equal time: the longest that all methods have reached."""
        if not self.series:
            return ()
        time = min(max(level.seconds["total"] for level in series.levels) for series in self.series)
        return tuple(self._shown(series, time) for series in self.series)

    def _shown(self, series: Series, time: float) -> Shown:
        row = min(
            (row for level in series.levels for row in level.rows),
            key=lambda row: (abs(math.log(row.total_s / time)), row.seed),
        )
        image = read_shot(self.folder / row.picture).image
        reference = self.reference.halves.mean(axis=0)
        difference = np.divide(image.y(), reference, out=np.full(reference.shape, np.nan), where=reference > 0) - 1.0
        return Shown(series, row, image, difference)


def gather_findings(study: Study, outcome: Outcome, folder: Path) -> tuple[Findings, ...]:
    """Put the rows of a study together, scene by scene."""
    return tuple(_of_subject(study, subject, outcome, folder) for subject in study.subjects)


def _of_subject(study: Study, subject: Subject, outcome: Outcome, folder: Path) -> Findings:
    reference, why = outcome.references[subject.identity]
    mine = [row for row in outcome.rows if row.scene_hash == subject.identity]
    series = []
    for method in study.methods:
        of_method = [row for row in mine if (row.method, row.gather_count) == (method.name, method.gather_count or 0)]
        levels = [make_level(rows, reference, folder) for rows in _by_photons(of_method)]
        if levels:
            series.append(make_series(method, levels, is_alike=method == Method(reference.kind)))
    return Findings(subject, reference, why, tuple(series), folder)


def _by_photons(rows: Sequence[ErrorRow]) -> list[list[ErrorRow]]:
    groups: dict[int, list[ErrorRow]] = {}
    for row in rows:
        groups.setdefault(row.photons, []).append(row)
    return list(groups.values())
