"""Runs that differ by their seed alone, together; and what a series of photon counts says: where noise ends, bias begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinrender.analysis.error_bench import read_shot
from skinrender.analysis.error_reference import ReferencePicture
from skinrender.analysis.error_rows import STAGES, ErrorRow
from skinrender.analysis.error_stats import (
    PowerLaw,
    Uncertain,
    bias_of_mean,
    bias_squared,
    color_noise,
    fit_power_law,
    noise_relative,
    noise_squared,
    relative_squared_error,
)
from skinrender.analysis.error_study import Method, count_text

UNKNOWN = Uncertain(math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class Level:
    """All runs of one scene, method and photon count.

    Parameters
    ----------
    rows : of the runs.
    relmse : mean over the runs.
    noise2, bias2 : its parts, variance and squared bias, relative; unknown for a single run.
    bias : of the mean luminance.
    true_noise : standard error of a pixel over its luminance from pairs of runs, beside which `claimed` stands.
    delta_e_noise : CIEDE2000 that noise alone makes, from pairs of runs.
    """

    rows: tuple[ErrorRow, ...]
    relmse: Uncertain
    noise2: Uncertain
    bias2: Uncertain
    bias: Uncertain
    true_noise: float
    delta_e_noise: float

    @property
    def photons(self) -> int:
        """Wanted. Small runs store more: a round has at least one history of every band."""
        return self.rows[0].photons

    @property
    def stored(self) -> float:
        """Photons stored, mean over the runs."""
        return self.mean("photons_stored")

    @property
    def seconds(self) -> dict[str, float]:
        """By stage, mean over the runs."""
        return {stage: self.mean(f"{stage}_s") for stage in STAGES}

    @property
    def claimed(self) -> float:
        """What the pictures claim as `true_noise`."""
        return self.mean("stderr_relative_mean")

    @property
    def efficiency(self) -> float:
        """1 / (relMSE seconds); nan where no error is resolved."""
        return 1.0 / (self.relmse.value * self.seconds["total"]) if self.relmse.value > 0 else math.nan

    @property
    def is_resolved(self) -> bool:
        """Whether the relMSE is surely above 0."""
        return self.relmse.value > 0 and not self.relmse.interval[0] <= 0

    def mean(self, column: str) -> float:
        """Mean of a column over the runs."""
        return float(np.mean([getattr(row, column) for row in self.rows]))


@dataclass(frozen=True, eq=False)
class Series:
    """One method on one scene over photon counts.

    Parameters
    ----------
    levels : ascending by photons.
    by_seconds, by_photons : relMSE, less the floor, as a power law where noise rules; None where it cannot be fitted.
    floor : squared bias, relative, at the level where it is known best; None where it cannot be told.
    is_alike : the reference is by the same estimate, so that no bias can show.
    """

    method: Method
    levels: tuple[Level, ...]
    by_seconds: PowerLaw | None
    by_photons: PowerLaw | None
    floor: Uncertain | None
    is_alike: bool = False

    @property
    def floor_is_seen(self) -> bool:
        """Whether there is surely a bias."""
        return self.floor is not None and self.floor.is_surely_positive

    @property
    def photons_at_floor(self) -> float:
        """Photons at which noise and bias are equal; nan without a floor."""
        if not self.floor_is_seen:
            return math.nan
        each = [level.noise2.value * level.stored for level in self.levels if level.noise2.value > 0]
        return math.exp(np.mean(np.log(each[-2:]))) / self.floor.value if each else math.nan

    @property
    def seconds_at_floor(self) -> float:
        """Seconds that so many photons take: between the levels on a line in logarithms, beyond them in proportion."""
        photons = self.photons_at_floor
        counts = [level.stored for level in self.levels]
        seconds = [level.seconds["total"] for level in self.levels]
        if not photons > 0:
            return math.nan
        inside = math.exp(np.interp(math.log(photons), np.log(counts), np.log(seconds)))
        return inside * max(1.0, photons / counts[-1])

    def verdict(self) -> str:
        """What can be said about noise and bias, in a sentence."""
        if self.is_alike:
            return "bias cannot show: the reference is by the same estimate"
        if self.floor is None:
            return "noise and bias cannot be told apart: that takes two seeds or more"
        if not math.isfinite(self.floor.stderr):
            return "noise and bias cannot be told apart: the picture is too small"
        low, high = self.floor.interval
        if not self.floor_is_seen:
            return f"no bias seen for sure; a root mean square above {_percent(high)} is ruled out at 95 %"
        where = f"bias of {_percent(self.floor.value)} (rms; {_percent(low)} to {_percent(high)})"
        photons, seconds = self.photons_at_floor, self.seconds_at_floor
        if photons > self.levels[-1].stored:
            return f"{where}; noise still rules, up to about {count_text(photons)} photons"
        return f"{where} rules beyond about {count_text(photons)} photons, {seconds:.2g} s"


def make_level(rows: Sequence[ErrorRow], reference: ReferencePicture, folder: Path) -> Level:
    """Read the pictures of runs that differ by their seed alone.

    Parameters
    ----------
    folder : that the rows' pictures are relative to.
    """
    shots = [read_shot(folder / row.picture) for row in rows]
    pictures = np.stack([shot.image.y().astype(float) for shot in shots])
    several = len(rows) > 1
    return Level(
        rows=tuple(rows),
        relmse=relative_squared_error(pictures, reference.halves),
        noise2=noise_squared(pictures, reference.halves) if several else UNKNOWN,
        bias2=bias_squared(pictures, reference.halves) if several else UNKNOWN,
        bias=bias_of_mean([shot.mean for shot in shots], reference.mean),
        true_noise=noise_relative(pictures) if several else math.nan,
        delta_e_noise=color_noise(np.stack([shot.image.lab() for shot in shots])) if several else math.nan,
    )


def make_series(method: Method, levels: Sequence[Level], is_alike: bool = False) -> Series:
    """Fit what the levels of one method on one scene say; `is_alike`: see `Series`."""
    levels = tuple(sorted(levels, key=lambda level: level.photons))
    known = [level.bias2 for level in levels if math.isfinite(level.bias2.value) and not is_alike]
    floor = min(known, key=lambda part: part.stderr if math.isfinite(part.stderr) else math.inf) if known else None
    bias2 = floor.value if floor is not None and floor.is_surely_positive else 0.0
    noisy = [row for level in levels if level.is_resolved and not level.noise2.value < bias2 for row in level.rows]
    noise = np.array([row.relmse - bias2 for row in noisy])
    return Series(
        method, levels,
        by_seconds=fit_power_law(np.array([row.total_s for row in noisy]), noise),
        by_photons=fit_power_law(np.array([row.photons_stored for row in noisy]), noise),
        floor=floor, is_alike=is_alike,
    )  # fmt: skip


def _percent(square: float) -> str:
    """The root of a relative square, in percent."""
    return f"{100 * math.sqrt(max(square, 0.0)):.2g} %"
