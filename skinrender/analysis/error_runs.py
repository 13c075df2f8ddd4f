"""Runs methods x photon counts x seeds against a reference; every finished run is a row on the disk."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from skinrender.analysis.error_bench import Bench, Traced, read_shot, write_shot
from skinrender.analysis.error_budget import PROBES, Budget
from skinrender.analysis.error_reference import (
    TIMES_LARGEST,
    ReferencePicture,
    errors_of,
    find_reference,
    kind_of_reference,
    make_reference,
)
from skinrender.analysis.error_rows import STAGES, ErrorRow, RowFile
from skinrender.analysis.error_study import Method, Study, Subject, bench_hash, count_text, program_hash
from skinrender.atomic import clear_partial_files
from skinrender.engine.clock import StageClock
from skinrender.engine.crew import Crew
from skinrender.engine.interrupt import Interrupted
from skinrender.errors import InputError

ROWS_NAME = "error_vs_time.csv"
PARTS_NAME, PICTURES_NAME, REFERENCES_NAME = "report", "pictures", "references"


@dataclass(frozen=True)
class Task:
    """A trace, and the methods whose pictures are still to be taken of it."""

    subject: Subject
    photons: int
    seed: int
    methods: tuple[Method, ...]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a study found.

    Parameters
    ----------
    rows : of this study, old and new.
    references : by the identity of the subject, with the reason for their kind.
    left_out : tasks that the time budget did not allow.
    new_rows : how many were run now.
    seconds : that it took now.
    """

    rows: tuple[ErrorRow, ...]
    references: dict[str, tuple[ReferencePicture, str]]
    left_out: tuple[Task, ...]
    new_rows: int
    seconds: float


class StudyRun:
    """A study at work in a folder.

    Parameters
    ----------
    study, out : what is compared, and where the files go; the caller holds the folder's lock.
    progress : bars on terminals.
    detail : receives what is decided, a line each.
    """

    def __init__(
        self, study: Study, out: Path, *, progress: bool = True, detail: Callable[[str], None] = lambda _: None
    ) -> None:
        self.study, self.out, self.progress, self.detail = study, out, progress, detail
        self.program = bench_hash(study.workers)
        self.rows = RowFile(out / ROWS_NAME)
        self.budget = Budget(study.target_seconds)
        self._parts = out / PARTS_NAME
        self._benches: dict[str, Bench] = {}
        self._warm: set[str] = set()

    def run(self) -> Outcome:
        """Run what is not there yet; raises `Interrupted` with finished rows kept."""
        for folder in (PICTURES_NAME, REFERENCES_NAME):
            clear_partial_files(self._parts / folder)
        try:
            found = self._run()
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted; {len(self.rows.rows)} finished runs are kept in {self.rows.path}\n"
                "  the same command goes on from them"
            ) from None
        finally:
            for bench in self._benches.values():
                bench.clear()
        shutil.rmtree(self._work, ignore_errors=True)
        return found

    @property
    def _work(self) -> Path:
        return self._parts / "work"

    def _run(self) -> Outcome:
        began = time.perf_counter()
        references = {subject.identity: self._reference(subject) for subject in self.study.subjects}
        self._refresh({identity: reference for identity, (reference, _) in references.items()})
        known, left_out = len(self.rows.rows), []
        tasks = self._tasks()
        self._learn_pace()
        hide = None if self.progress else True
        with tqdm(total=sum(t.photons for t in tasks), unit=" photons", unit_scale=True, disable=hide, desc="report") as bar:
            for task in tasks:
                if self.budget.allows(task.subject.identity, task.photons):
                    self._do(task, references[task.subject.identity][0])
                else:
                    left_out.append(task)
                bar.update(task.photons)
        rows = [row for key in self._keys() for row in self.rows.rows if row.key == key]
        spent = time.perf_counter() - began
        return Outcome(tuple(rows), references, tuple(left_out), len(self.rows.rows) - known, spent)

    # --- reference

    def _reference(self, subject: Subject) -> tuple[ReferencePicture, str]:
        kind, why = kind_of_reference(subject, self.study.reference)
        folder, largest = self._parts / REFERENCES_NAME, max(self.study.counts_of(subject))
        wanted = self.study.reference_photons or TIMES_LARGEST[kind] * largest
        fixed = self.study.reference_photons is not None or not self.budget.is_limited
        program = program_hash()
        found = find_reference(folder, subject, kind, program, wanted if fixed else 0)
        if found is None:
            bench = self._warm_bench(subject, Method(kind))
            if not fixed:
                self._warm_bench(subject, *self.study.methods)
                least = 2 * min(self.study.counts_of(subject))
                self._probe(bench, kind)
                wanted = self.budget.reference_photons((subject.identity, kind), wanted, least, len(self.study.subjects))
            self.detail(f"{subject.label}: reference by {kind} ({why}), {count_text(wanted)} photons")
            found = make_reference(folder, bench, kind, program, wanted)
        return found, why

    def _probe(self, bench: Bench, kind: str) -> None:
        """Short runs that tell the pace of the reference and of the runs."""
        for photons in PROBES:
            began = time.perf_counter()
            with bench.traced(photons, bench.subject.scene.photons.seed) as traced:
                traced_s = time.perf_counter() - began
                spent = {method: self._time(bench, traced, method) for method in (Method(kind), *self.study.methods)}
            self.budget.pace((bench.subject.identity, kind)).add(photons, traced_s + spent[Method(kind)])
            runs = sum(spent[method] for method in self.study.methods)
            self.budget.pace(bench.subject.identity).add(photons, traced_s + runs)

    @staticmethod
    def _time(bench: Bench, traced: Traced, method: Method) -> float:
        clock = StageClock()
        bench.shoot(traced.photon_map, method, clock)
        return clock.seconds["total"]

    # --- rows

    def _keys(self) -> list[tuple]:
        """Of all rows of the study, in the order of the page."""
        return [
            _key(subject, method, photons, seed, self.program)
            for subject in self.study.subjects
            for method in self.study.methods
            for photons in self.study.counts_of(subject)
            for seed in self.study.seeds_of(subject)
        ]

    def _tasks(self) -> list[Task]:
        """What has no row yet, smallest photon counts first."""
        done = {row.key for row in self.rows.rows}
        tasks = []
        for subject in self.study.subjects:
            for photons in self.study.counts_of(subject):
                for seed in self.study.seeds_of(subject):
                    missing = tuple(
                        method for method in self.study.methods
                        if _key(subject, method, photons, seed, self.program) not in done
                    )  # fmt: skip
                    if missing:
                        tasks.append(Task(subject, photons, seed, missing))
        return sorted(tasks, key=lambda task: task.photons)

    def _learn_pace(self) -> None:
        """From the rows that are there."""
        spent: dict[tuple[str, int], dict[Any, float]] = {}
        for row in self.rows.rows:
            if row.program == self.program:
                by_method = spent.setdefault((row.scene_hash, row.photons), {"trace": row.load_s + row.trace_s})
                by_method[row.method, row.gather_count] = row.estimate_s + row.write_s
        for (identity, photons), parts in spent.items():
            self.budget.pace(identity).add(photons, sum(parts.values()))

    def _refresh(self, references: dict[str, ReferencePicture]) -> None:
        """Drop rows whose picture is gone; hold those that were held against another reference against this one."""
        rows = [self._renewed(row, references.get(row.scene_hash)) for row in self.rows.rows]
        if rows != self.rows.rows:
            self.rows.replace(row for row in rows if row is not None)

    def _renewed(self, row: ErrorRow, reference: ReferencePicture | None) -> ErrorRow | None:
        if reference is None or row.program != self.program:
            return row
        path = self.out / row.picture
        if not path.is_file():
            return None
        if row.reference == reference.identity:
            return row
        try:
            return replace(row, **errors_of(read_shot(path), reference, row.total_s))
        except InputError:
            return None

    def _do(self, task: Task, reference: ReferencePicture) -> None:
        bench, began = self._warm_bench(task.subject, *task.methods), time.perf_counter()
        with bench.traced(task.photons, task.seed) as traced:
            for method in task.methods:
                self.rows.append(self._row(task, bench, traced, method, reference))
        whole = len(self.study.methods) / len(task.methods)
        self.budget.pace(task.subject.identity).add(task.photons, whole * (time.perf_counter() - began))

    def _row(
        self, task: Task, bench: Bench, traced: Traced, method: Method, reference: ReferencePicture
    ) -> ErrorRow:
        clock = StageClock()
        shot = bench.shoot(traced.photon_map, method, clock)
        name = f"{task.subject.identity}_{_slug(method)}_{task.photons}_{task.seed}_{self.program}.exr"
        path = self._parts / PICTURES_NAME / name
        write_shot(shot, path, {"stage": "report", "hash": task.subject.identity}, clock)
        seconds = {**traced.seconds, **clock.seconds}
        seconds["load"] += bench.load_seconds
        seconds["total"] = sum(seconds[stage] for stage in STAGES[:-1])
        return ErrorRow(
            scene=task.subject.label, scene_hash=task.subject.identity, method=method.name,
            gather_count=method.gather_count or 0, photons=task.photons, seed=task.seed, program=self.program,
            workers=Crew(self.study.workers).workers_for(task.photons),
            photons_stored=traced.summary.stored, photons_emitted=traced.summary.emitted,
            **{f"{stage}_s": seconds[stage] for stage in STAGES},
            **errors_of(shot, reference, seconds["total"]),
            picture=path.relative_to(self.out).as_posix(), finished=datetime.now(UTC).isoformat(timespec="seconds"),
        )  # fmt: skip

    # --- benches

    def _warm_bench(self, subject: Subject, *methods: Method) -> Bench:
        """The bench of a scene, with kernels loaded for these methods."""
        bench = self._benches.get(subject.identity)
        if bench is None:
            folder = self._work / f"{subject.identity}_{self.program}"
            bench = self._benches[subject.identity] = Bench(subject, folder, self.study.workers, self.progress)
        cold = {method.name: method for method in methods if f"{subject.identity} {method.name}" not in self._warm}
        if cold:
            bench.warm_up(tuple(cold.values()))
            self._warm |= {f"{subject.identity} {name}" for name in cold}
        return bench


def left_out_lines(tasks: Iterable[Task]) -> list[str]:
    """What was left out, for people."""
    return [f"{t.subject.label}, {count_text(t.photons)} photons, seed {t.seed}: {', '.join(m.label for m in t.methods)}" for t in tasks]


def _key(subject: Subject, method: Method, photons: int, seed: int, program: str) -> tuple:
    return subject.identity, method.name, method.gather_count or 0, photons, seed, program


def _slug(method: Method) -> str:
    return method.name if method.gather_count is None else f"{method.name}-{method.gather_count}"
