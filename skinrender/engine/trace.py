"""The trace stage: scene and volume in, photon map out (paper, section 7.1).

Rounds are walked by any number of workers, each writes its own file, and the files are streamed into one map, the same
bytes whoever walked them. A run that was stopped goes on from the files that are there.
"""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import clear_partial_files
from skinrender.engine.clock import StageClock
from skinrender.engine.crew import Crew
from skinrender.engine.disk import check_free_space, disk_errors
from skinrender.engine.executor import leave_unguarded_script
from skinrender.engine.interrupt import Interrupt, Interrupted, listen
from skinrender.engine.ledger import Ledger
from skinrender.engine.lock import folder_lock
from skinrender.engine.recipe import Recipe, scene_recipe
from skinrender.engine.rounds import RoundPlan
from skinrender.engine.run import Run, complete_provenance, plan_run
from skinrender.engine.stop import Never, Stop, StoredCount
from skinrender.engine.summary import TraceSummary, summarize
from skinrender.errors import InputError, RunError
from skinrender.photonmap.photon_map import PhotonMap, check_provenance, open_map
from skinrender.photonmap.store import (
    MapHeader,
    RoundCounts,
    read_header,
    round_files,
    round_path,
    write_header,
    write_map,
)
from skinrender.scene import Scene

MAP_NAME = "photons.npz"
ROUNDS_NAME = "rounds"
HEADER_NAME = "run.npz"


def trace(
    scene: Scene,
    volume_path: str | Path,
    out_dir: str | Path,
    *,
    workers: int | None = None,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
    stop: Stop | None = None,
    progress: bool = True,
    clock: StageClock | None = None,
    recipe: Recipe | None = None,
    open_executor: Callable[[], Executor] | None = None,
) -> TraceSummary:
    """Trace photons until enough are stored and write ``photons.npz``.

    Parameters
    ----------
    scene : its ``photons`` and ``light`` are read.
    volume_path : the ``volume.npz`` to walk in.
    out_dir : made if need be; finished rounds lie in its ``rounds`` until the map is complete.
    workers, progress, open_executor : see `crew.Crew`. More than one worker are processes, which import the script that
        started them: in a script call this under ``if __name__ == "__main__":``.
    resume : go on from the rounds that are there.
    shard : (i, n), 0 <= i < n: walk rounds i, i + n, ... only and leave them for `shards.merge`.
    stop : another rule than the scene's number of stored photons.
    clock : receives the seconds of the stages ``load`` and ``trace``.
    recipe : another way to make the photon pass.

    Raises
    ------
    InputError : another run has the folder, there is nothing fitting to resume, or workers cannot begin.
    RunError : the disk is full or read-only, workers keep dying, or a photon is lost.
    Interrupted : by SIGINT or SIGTERM; finished rounds are kept.
    """
    leave_unguarded_script()
    _check_shard(shard, stop)
    out_dir, clock = Path(out_dir).absolute(), clock or StageClock()
    crew = Crew(workers, progress, open_executor)
    with disk_errors(out_dir):
        out_dir.mkdir(parents=True, exist_ok=True)
        with folder_lock(out_dir):
            try:
                with clock.stage("load"):
                    recipe = recipe or scene_recipe(scene, volume_path)
                    photons = scene.photons
                    run, plan = plan_run(recipe, photons.seed, photons.stored, photons.wavelengths)
                with clock.stage("trace"), listen() as interrupt:
                    if shard is None:
                        stop = stop or StoredCount(plan.stored_wanted)
                        summary = _whole(out_dir, run, plan, stop, crew, interrupt, resume)
                    else:
                        summary = _shard(out_dir, run, plan, shard, crew, interrupt, resume)
            except KeyboardInterrupt:
                raise _interrupted(out_dir / ROUNDS_NAME) from None
            except MemoryError as error:
                raise RunError(
                    "out of memory; finished rounds are kept\n  go on with --resume and fewer --workers"
                ) from error
    return replace(summary, seconds=clock.seconds)


def summary_of_map(photon_map: PhotonMap) -> TraceSummary:
    """The trace summary of a finished map, without seconds."""
    ledger = Ledger(photon_map.power_per_band * photon_map.emitted_per_band)
    stored = np.diff(photon_map.round_band_start).reshape(photon_map.rounds, photon_map.bands)
    emitted = np.asarray(photon_map.provenance["histories_per_round"], np.int64)
    for index, tallies in enumerate(photon_map.tallies):
        ledger.add(RoundCounts(index, emitted, stored[index], np.asarray(tallies)))
    return summarize(ledger, photon_map.wavelength_nm, photon_map.layer_name)


def finish_map(
    path: Path,
    header: MapHeader,
    stop: Stop,
    rounds: list[RoundCounts],
    paths: list[Path],
    check: Callable[[], None] = lambda: None,
) -> None:
    """Stream the rounds of a complete run into its map; what `check`, called often, raises ends it."""
    write_map(path, replace(header, provenance=complete_provenance(header, stop)), rounds, paths, check)


def _whole(
    out_dir: Path, run: Run, plan: RoundPlan, stop: Stop, crew: Crew, interrupt: Interrupt, resume: bool
) -> TraceSummary:
    map_path, folder = out_dir / MAP_NAME, out_dir / ROUNDS_NAME
    if resume and (finished := _finished(map_path, complete_provenance(run.header, stop))) is not None:
        shutil.rmtree(folder, ignore_errors=True)
        return summary_of_map(finished)
    _begin_rounds(folder, run.header, resume)
    check_free_space(out_dir, run.rounds_bytes(plan) + run.map_bytes(plan) - _size(folder))
    ledger = run.new_ledger()
    crew.walk(run.work(folder), itertools.count(), ledger, stop, interrupt, plan.stored_wanted)
    paths = [round_path(folder, counts.index) for counts in ledger.rounds]
    finish_map(map_path, run.header, stop, ledger.rounds, paths, interrupt.check)
    shutil.rmtree(folder)
    return run.summary(ledger)


def _shard(
    out_dir: Path, run: Run, plan: RoundPlan, shard: tuple[int, int], crew: Crew, interrupt: Interrupt, resume: bool
) -> TraceSummary:
    folder = out_dir / ROUNDS_NAME
    _begin_rounds(folder, run.header, resume)
    check_free_space(out_dir, run.rounds_bytes(plan) / shard[1] - _size(folder))
    ledger = run.new_ledger()
    indices = range(shard[0], plan.rounds_enough, shard[1])
    crew.walk(run.work(folder), indices, ledger, Never(), interrupt, plan.stored_wanted // shard[1])
    return run.summary(ledger)


def _interrupted(folder: Path) -> Interrupted:
    kept = len(round_files(folder))
    told = f"; {kept} finished rounds are kept in {folder}" if kept else ""
    return Interrupted(f"interrupted{told}\n  go on with the same command and --resume")


def _finished(path: Path, provenance: Mapping[str, Any]) -> PhotonMap | None:
    if not path.exists():
        return None
    try:
        return open_map(path, expected=provenance, verify=True)
    except InputError:
        return None


def _begin_rounds(folder: Path, header: MapHeader, resume: bool) -> None:
    """Make the rounds' folder, empty or with rounds of this very run; raises `InputError` if they are of another."""
    if not resume and folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(exist_ok=True)
    clear_partial_files(folder)
    path = folder / HEADER_NAME
    if round_files(folder):
        check_provenance(
            folder,
            _header_provenance(path),
            header.provenance,
            remedy="go back to the scene, program and machine of these rounds, or start again without --resume",
        )
    write_header(path, header)


def _header_provenance(path: Path) -> Mapping[str, Any]:
    try:
        return read_header(path).provenance
    except InputError:
        return {}


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in round_files(folder).values())


def _check_shard(shard: tuple[int, int] | None, stop: Stop | None) -> None:
    if shard is None:
        return
    if not 0 <= shard[0] < shard[1]:
        raise InputError(
            f"there is no shard {shard[0]}/{shard[1]}", where="--shard", remedy="shards of n count from 0/n to (n-1)/n"
        )
    if stop is not None:
        raise InputError(
            "a shard cannot know when the whole run meets this stop rule",
            where="--shard",
            remedy="give the number of photons (--photons) instead",
        )
