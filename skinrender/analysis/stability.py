"""The stiff and extreme cases: all of them, run, and written as a table."""

from __future__ import annotations

import csv
import fnmatch
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from skinrender.analysis import (
    stability_borders,
    stability_geometry,
    stability_map,
    stability_optics,
    stability_precision,
    stability_skin,
)
from skinrender.analysis.stability_case import Case, Measure, Refused, measure
from skinrender.atomic import whole_file
from skinrender.engine.executor import in_order
from skinrender.errors import InputError

_THEMES = {
    "Optics of the tissue": stability_optics,
    "Borders": stability_borders,
    "Geometry": stability_geometry,
    "Photon map and light": stability_map,
    "Skin": stability_skin,
    "Precision": stability_precision,
}


@cache
def all_cases() -> tuple[Case | Refused, ...]:
    """Every case, by theme."""
    return tuple(case for theme in _THEMES.values() for case in theme.CASES)


@cache
def theme_of() -> dict[str, str]:
    """Theme of each case, by its name."""
    return {case.name: theme for theme, module in _THEMES.items() for case in module.CASES}


@dataclass(frozen=True)
class Found:
    """What a case gave.

    Parameters
    ----------
    case, could_break : of the case.
    measures : all that was measured.
    seconds : spent.
    """

    case: str
    could_break: str
    measures: tuple[Measure, ...]
    seconds: float

    @property
    def ok(self) -> bool:
        return all(measure.ok for measure in self.measures)

    @property
    def decisive(self) -> Measure:
        """The measure that comes nearest to its bound, or passes it."""
        return max(self.measures, key=lambda measure: measure.share)

    def as_json(self) -> dict[str, Any]:
        """As ``skinrender check --json`` lists it."""
        return {
            "case": self.case,
            "could_break": self.could_break,
            "quantity": self.decisive.quantity,
            "measured": self.decisive.measured,
            "bound": self.decisive.bound,
            "ok": self.ok,
            "measures": [{**vars(measure), "ok": measure.ok} for measure in self.measures],
            "seconds": self.seconds,
        }


@dataclass(frozen=True)
class CaseNumber:
    """What a worker is sent: it runs the case of a number."""

    seed: int

    def __call__(self, index: int) -> Found:
        case, began = all_cases()[index], time.monotonic()
        found = tuple(measure(case, self.seed))
        return Found(case.name, case.could_break, found, time.monotonic() - began)


def planned_cases(only: str | None = None) -> list[int]:
    """Numbers of the cases whose name begins so or matches a pattern.

    Raises `InputError` if there is none.
    """
    names = [case.name for case in all_cases()]
    chosen = [k for k, name in enumerate(names) if only is None or name.startswith(only) or fnmatch.fnmatch(name, only)]
    if not chosen:
        raise InputError(f"no case is named like {only!r}", where="--only", remedy="cases: " + "; ".join(names))
    return chosen


def run_cases(
    numbers: Sequence[int],
    seed: int = 1,
    workers: int | None = None,
    watch: Callable[[Iterable, int], Iterable] = lambda items, count: items,
) -> list[Found]:
    """Run cases by their numbers, in order.

    Parameters
    ----------
    seed : of all photons; each scene of each case has a stream of its own.
    workers : processes; all cores by default.
    watch : is given what is found as it comes, and the number of cases; shows progress.
    """
    workers = min(workers or os.cpu_count() or 1, len(numbers))
    return list(watch(in_order(CaseNumber(seed), numbers, workers=workers), len(numbers)))


def write_cases(path: Path, found: Iterable[Found]) -> None:
    """Write ``check.csv``: a row for each measure of each case."""
    with whole_file(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["case", "could_break", "quantity", "measured", "bound", "ok", "seconds"])
        for one in found:
            for m in one.measures:
                numbers = [f"{m.measured:.6g}", f"{m.bound:g}", m.ok, f"{one.seconds:.2f}"]
                table.writerow([one.case, one.could_break, m.quantity, *numbers])
