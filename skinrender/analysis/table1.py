"""The paper's table 1: seconds of each stage, point against beam, beside the paper's own.

``python -m skinrender.analysis.table1 POINT_DIR BEAM_DIR`` reads the ``timing.csv`` of two ``render`` folders.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping
from pathlib import Path

from skinrender.errors import InputError

STAGES = ("load", "trace", "estimate", "total")
PAPER = {
    "point": {"load": 2, "trace": 6274, "estimate": 11754, "total": 18030},
    "beam": {"load": 2, "trace": 6281, "estimate": 1740, "total": 8023},
}
"""Seconds on two Xeon X5550, 16 threads, 324 million photons (table 1)."""


def seconds_of(folder: Path) -> dict[str, float]:
    """Seconds of each stage in the newest run of a folder's ``timing.csv`` that went through all of them.

    Raises
    ------
    InputError : there is no such file or no such run.
    """
    path = folder / "timing.csv"
    runs: dict[tuple[str, str], dict[str, float]] = {}
    try:
        with open(path, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                runs.setdefault((row["finished"], row["command"]), {})[row["stage"]] = float(row["seconds"])
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(path), remedy="run `skinrender render` first") from None
    except (KeyError, TypeError, ValueError):
        raise InputError("is not a timing.csv of this program", where=str(path)) from None
    whole = [run for run in runs.values() if run.keys() >= set(STAGES)]
    if not whole:
        raise InputError(
            "holds no run of all stages", where=str(path), remedy="run `skinrender render` in a new folder"
        )
    return whole[-1]


def table(point: Mapping[str, float], beam: Mapping[str, float]) -> str:
    """Table 1 in Markdown."""
    lines = ["| seconds | point | beam | point, paper | beam, paper |", "|---|---:|---:|---:|---:|"]
    stages = [*STAGES[:-1], *(stage for stage in beam if stage not in STAGES), STAGES[-1]]
    for stage in stages:
        here = [f"{column[stage]:.2f}" if stage in column else "" for column in (point, beam)]
        paper = [str(PAPER[method].get(stage, "")) for method in ("point", "beam")]
        lines.append("| " + " | ".join([stage, *here, *paper]) + " |")
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Print the table of two folders; returns the exit code."""
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        print(table(*(seconds_of(Path(folder)) for folder in arguments)))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
