"""The paper's table 1: seconds of each stage, point against beam, beside the paper's own.

``python -m skinrender.analysis.table1 POINT_DIR BEAM_DIR`` reads the ``timing.csv`` of two ``render`` folders.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from skinrender.analysis.tool import options, tool
from skinrender.errors import InputError

STAGES = ("load", "trace", "estimate", "total")
PAPER = {
    "point": {"load": 2, "trace": 6274, "estimate": 11754, "total": 18030},
    "beam": {"load": 2, "trace": 6281, "estimate": 1740, "total": 8023},
}
"""Seconds (table 1)."""
PAPER_PHOTONS, PAPER_GATHERED = 3.24e8, 32_400
"""Photons stored, and gathered by each beam or sample point (table 1)."""
PAPER_HARDWARE = (
    "two Intel Xeon X5550 (2.66 GHz), 24 GB, 16 threads; forearm, 200 x 200 pixels, 324 million photons stored, "
    "32 400 photons a beam or sample point"
)


def paper_options(method: str, photons: float = PAPER_PHOTONS) -> list[str]:
    """Options of `skinrender render` for the paper's settings; of fewer photons fewer are gathered, by the same kernel."""
    gathered = max(1, round(PAPER_GATHERED * photons / PAPER_PHOTONS))
    options = ["--method", method, "--photons", repr(float(photons)), "--gather-count", str(gathered)]
    return [*options, "--set", "photons.roulette=false"]


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


def cells(point: Mapping[str, float], beam: Mapping[str, float]) -> list[list[str]]:
    """Table 1, its head first: a row a stage; seconds here and in the paper, and how many times longer point takes."""
    head = ["seconds", "point", "beam", "point / beam", "point, paper", "beam, paper", "point / beam, paper"]
    stages = [*STAGES[:-1], *(stage for stage in beam if stage not in STAGES), STAGES[-1]]
    rows = [head]
    for stage in stages:
        here = [column.get(stage) for column in (point, beam)]
        paper = [PAPER[method].get(stage) for method in ("point", "beam")]
        seconds = ["" if value is None else f"{value:.2f}" for value in here]
        rows.append([stage, *seconds, _ratio(*here), *("" if value is None else str(value) for value in paper), _ratio(*paper)])
    return rows


def table(point: Mapping[str, float], beam: Mapping[str, float]) -> str:
    """Table 1 in Markdown."""
    head, *rows = cells(point, beam)
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1), *lines])


def _ratio(point: float | None, beam: float | None) -> str:
    return f"{point / beam:.2f}" if point is not None and beam else ""


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Print the table of two folders."""
    parser = options(__doc__)
    for method in ("point", "beam"):
        parser.add_argument(method, type=Path, metavar=f"{method.upper()}_DIR", help=f"folder of a render by {method}")
    wanted = parser.parse_args(arguments)
    print(table(seconds_of(wanted.point), seconds_of(wanted.beam)))


if __name__ == "__main__":
    sys.exit(main())
