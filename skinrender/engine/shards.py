"""Merging: rounds walked in several folders, by several machines, become one photon map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from skinrender.engine.clock import StageClock
from skinrender.engine.disk import check_free_space, disk_errors
from skinrender.engine.ledger import Ledger
from skinrender.engine.lock import folder_lock
from skinrender.engine.stop import StoredCount
from skinrender.engine.summary import TraceSummary, summarize
from skinrender.engine.trace import HEADER_NAME, MAP_NAME, ROUNDS_NAME, finish_map
from skinrender.errors import InputError
from skinrender.photonmap.photon_map import check_provenance
from skinrender.photonmap.store import MapHeader, RoundCounts, read_header, read_round, round_files


def merge(shard_dirs: Sequence[str | Path], out_dir: str | Path) -> TraceSummary:
    """Join the rounds of shards, cut where the undivided run would have stopped, and write ``photons.npz``.

    Parameters
    ----------
    shard_dirs : folders that ``trace --shard`` wrote; they stay as they are.
    out_dir : made if need be.

    Raises
    ------
    InputError : the shards are of different runs, a round is missing or damaged.
    RunError : the disk is full or read-only.
    """
    out_dir, clock = Path(out_dir), StageClock()
    folders = [Path(shard) / ROUNDS_NAME for shard in shard_dirs]
    with disk_errors(out_dir), clock.stage("merge"):
        out_dir.mkdir(parents=True, exist_ok=True)
        with folder_lock(out_dir):
            header = _common_header(folders)
            files = {index: path for folder in reversed(folders) for index, path in round_files(folder).items()}
            stop, ledger = StoredCount(header.stored_wanted), Ledger(header.power_aimed_per_band)
            while not stop.met(ledger):
                ledger.add(_round(files, len(ledger.rounds), header))
            paths = [files[counts.index] for counts in ledger.rounds]
            check_free_space(out_dir, sum(path.stat().st_size for path in paths))
            finish_map(out_dir / MAP_NAME, header, stop, ledger.rounds, paths)
    return summarize(ledger, header.wavelength_nm, header.layer_name, clock.seconds)


def _common_header(folders: Sequence[Path]) -> MapHeader:
    if not folders:
        raise InputError("there is nothing to merge", remedy="name the folders that `trace --shard` wrote")
    headers = [read_header(folder / HEADER_NAME) for folder in folders]
    first = headers[0]
    for folder, header in zip(folders, headers):
        check_provenance(
            folder,
            {**header.provenance, "stored": header.stored_wanted},
            {**first.provenance, "stored": first.stored_wanted},
            remedy=f"merge shards of one run only; the others are compared with {folders[0]}",
        )
    return first


def _round(files: dict[int, Path], index: int, header: MapHeader) -> RoundCounts:
    if index not in files:
        raise InputError(
            f"round {index} is in none of the shards",
            remedy="finish its shard with --resume; or gather all round files in the `rounds` of one shard's folder and "
            "run trace there with --resume, without --shard",
        )
    return read_round(files[index], header.key, verify=True)
