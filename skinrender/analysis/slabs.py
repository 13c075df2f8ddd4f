"""Check of the photon walk against truths of layered slabs: totals, absorption and scattering events by layer.

The walk is that of any scene. Truth files are of one of three schemas, see `slab_truth`; those of fields and of radial
profiles are checked in `slab_fields` and `slab_radial`.
"""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from skinrender.analysis.slab_fields import FieldCheck
from skinrender.analysis.slab_radial import RadialCheck
from skinrender.analysis.slab_stats import Result, distribution, events, fraction
from skinrender.analysis.slab_truth import FIELD, LAYERED, RADIAL, SlabRecord, read_truth
from skinrender.analysis.slab_walk import (
    Accuracy,
    RecordCheck,
    count_rounds,
    pilot_walk,
    planned_histories,
    record_seed,
    stack_scene,
)
from skinrender.atomic import whole_file
from skinrender.engine.executor import in_order
from skinrender.transport import tally

WORTH_A_POOL = 3e8
"""Scattering events below which starting processes takes longer than it saves."""
CONTRACT = Accuracy(fraction=1e-3, events=0.02)
_FRACTIONS = {
    "R_total": tally.REFLECTED,
    "T_total": tally.TRANSMITTED,
    "R_unscattered": tally.REFLECTED_UNSCATTERED,
    "T_unscattered": tally.TRANSMITTED_UNSCATTERED,
}


class Check(Protocol):
    """The check of one record; picklable."""

    @property
    def cost(self) -> float:
        """About how many scattering events it takes."""

    def __call__(self) -> RecordCheck:
        """Walk and compare."""


class LayeredCheck:
    """Check of a record of totals and values by layer.

    Raises `InputError` if the record lacks a value or no scene can be made of it.
    """

    def __init__(self, record: SlabRecord, seed: int, wanted: Accuracy) -> None:
        layers = len(record.stack.layers)
        self.id, self.seed, self.wanted = record.id, seed, wanted
        self.expected = {name: record.number(name, 0.0, 1.0) for name in _FRACTIONS}
        self.absorbed = record.numbers("A_layers", layers, 0.0, 1.0)
        self.scatterings = record.numbers("scatter_events", layers, 0.0)
        self.accuracy, self.accuracy_events = record.accuracy("abs"), record.accuracy("rel_max")
        self.scene = stack_scene(record)

    @property
    def cost(self) -> float:
        return (1.0 + sum(self.scatterings)) * 0.25 / self.wanted.fraction**2

    def __call__(self) -> RecordCheck:
        began = time.monotonic()
        fractions = [*self.expected.values(), *self.absorbed]
        pilots = pilot_walk(self.scene, self.seed, self.id)
        histories, is_limited = planned_histories(pilots, fractions, self.scatterings, self.wanted)
        summary = count_rounds(self.scene, record_seed(self.seed, self.id), histories)
        note = f"{self.id}: walked {histories} histories only; its standard errors are larger than wanted"
        return RecordCheck(
            tuple(self._results(summary)),
            summary.emitted,
            int(summary.counts[0, tally.scattered(len(self.absorbed))].sum()),
            time.monotonic() - began,
            note if is_limited else "",
        )

    def _results(self, summary: Any) -> Iterator[Result]:
        counts, histories, layers = summary.counts[0], summary.emitted, len(self.absorbed)
        for name, column in _FRACTIONS.items():
            yield fraction(self.id, name, self.expected[name], self.accuracy, int(counts[column]), histories)
        for i, (expected, count) in enumerate(zip(self.absorbed, counts[tally.absorbed(layers)])):
            yield fraction(self.id, f"A_layers[{i}]", expected, self.accuracy, int(count), histories)
        columns = tally.scattered(layers)
        got, stderr = summary.fractions[0, columns], summary.fractions_stderr[0, columns]
        for i, expected in enumerate(self.scatterings):
            layer = self.scene.slab.layers[i]
            yield events(
                self.id, f"scatter_events[{i}]", expected, self.accuracy_events * expected, float(got[i]),
                float(stderr[i]), histories, burst=_burst(layer.thickness_mm * layer.mu_s_per_mm),
            )  # fmt: skip


def _burst(optical_thickness: float) -> float:
    """About how often a photon scatters in a layer that it reaches, mean square over mean.

    Diffuse light stays in a slab for a mean path of twice its thickness (Cauchy's mean chord, which scattering leaves
    unchanged: Blanco and Fournier 2003); lengths are about exponentially distributed.
    """
    return 1.0 + 4.0 * optical_thickness


CHECKS: dict[str, Callable[[SlabRecord, int, Accuracy], Check]] = {
    LAYERED: LayeredCheck,
    FIELD: FieldCheck,
    RADIAL: RadialCheck,
}


@dataclass(frozen=True, eq=False)
class SlabCheck:
    """What the check of a file found: the records in the order of the file."""

    records: tuple[RecordCheck, ...]

    @property
    def results(self) -> list[Result]:
        return [result for record in self.records for result in record.results]

    @property
    def ok(self) -> bool:
        return all(result.ok for result in self.results)

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender check --slabs FILE --json`` prints."""
        return {
            "results": [result.as_json() for result in self.results],
            "ok": self.ok,
            "R_total_z": distribution([r.z for r in self.results if r.quantity == "R_total" and r.stderr > 0.0]),
            "histories": sum(record.histories for record in self.records),
            "scattering_events": sum(record.scatterings for record in self.records),
            "seconds": {"walk": sum(record.seconds for record in self.records)},
            "notes": [record.note for record in self.records if record.note],
        }


@dataclass(frozen=True, eq=False)
class CheckNumber:
    """What a worker is sent: it does the check of a number."""

    checks: Sequence[Check]

    def __call__(self, index: int) -> RecordCheck:
        return self.checks[index]()


def planned_checks(
    path: str | Path, *, only: str | None = None, seed: int = 1, wanted: Accuracy = CONTRACT
) -> list[Check]:
    """The checks of a truth file's records; nothing is walked.

    Parameters
    ----------
    path, only : see `slab_truth.read_truth`.
    seed : of all photons; each record has streams of its own.
    wanted : standard errors.

    Raises
    ------
    InputError : the file can't be used; the message names record, key and remedy.
    """
    truth = read_truth(path, only)
    return [CHECKS[truth.schema](record, seed, wanted) for record in truth.records]


def run_checks(
    checks: Sequence[Check],
    workers: int | None = None,
    watch: Callable[[Iterable, int], Iterable] = lambda items, count: items,
) -> SlabCheck:
    """Walk and compare.

    Parameters
    ----------
    workers : processes; by default what the work is worth.
    watch : is given the records' checks as they are done, and their number; shows progress.
    """
    costs = [check.cost for check in checks]
    order = sorted(range(len(checks)), key=lambda i: -costs[i])
    if workers is None:
        workers = min(os.cpu_count() or 1, len(checks)) if sum(costs) >= WORTH_A_POOL else 1
    done = watch(in_order(CheckNumber(checks), order, workers=workers), len(checks))
    found = dict(zip(order, done, strict=True))
    return SlabCheck(tuple(found[i] for i in range(len(checks))))


def check_slabs(
    path: str | Path,
    *,
    only: str | None = None,
    seed: int = 1,
    wanted: Accuracy = CONTRACT,
    workers: int | None = None,
) -> SlabCheck:
    """Walk the stacks of a truth file and compare; see `planned_checks` and `run_checks`."""
    return run_checks(planned_checks(path, only=only, seed=seed, wanted=wanted), workers)


def write_results(path: Path, results: Iterable[Result]) -> None:
    """Write ``check.csv``: a row for each result."""
    with whole_file(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "quantity", "expected", "got", "stderr", "z", "ok"])
        for r in results:
            table.writerow([r.id, r.quantity, repr(r.expected), repr(r.got), f"{r.stderr:.6g}", f"{r.z:.4f}", r.ok])
