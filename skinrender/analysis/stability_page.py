"""check.html: the stiff and extreme cases, what each could break, what was measured, its bound and the verdict."""

from __future__ import annotations

import itertools
import os
import platform
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from skinrender.analysis import html_page as html
from skinrender.analysis.stability import Found, theme_of
from skinrender.atomic import whole_file
from skinrender.engine.clock import cpu_name

PAGE_NAME = "check.html"
LIBRARIES = ("skinrender", "numpy", "numba")
HOW = (
    "Each case is one or more small scenes that go the way of any other: volume, photon pass, photon map, pictures by "
    "beam and by point, files. Those under Precision compare single and double precision instead.",
    "In every case of scenes each photon must be accounted for, exactly in counts, and no pixel may be negative, infinite "
    "or not a number.",
    "Where a closed form is known, z is the distance from it in standard errors; at a limit (an index step of 1e-9, "
    "a layer of 1e-9 mm) it is the distance between the two sides. A bound of 0 allows nothing at all.",
    "A row shows the measure that comes nearest to its bound; all of them are in check.csv.",
)


def write_page(path: Path, found: Sequence[Found], seed: int) -> None:
    """Write the page of some cases that were run with a seed.

    Raises
    ------
    RunError : it cannot be written.
    """
    with whole_file(path) as partial:
        partial.write_text(html.page("Stiff and extreme cases", _parts(found, seed)), encoding="utf-8")


def _parts(found: Sequence[Found], seed: int) -> Iterator[str]:
    off = [one.case for one in found if not one.ok]
    measures = sum(len(one.measures) for one in found)
    verdict = "all within their bounds" if not off else f"{len(off)} of them off"
    yield "<h1>Stiff and extreme cases</h1>"
    yield f'<p class="lead">{len(found)} cases, {measures} measures: {verdict}.</p>'
    if off:
        yield html.items(off)
    yield html.items(HOW)
    for theme, members in itertools.groupby(found, key=lambda one: theme_of().get(one.case, "Others")):
        yield _theme(theme, list(members))
    yield "<h2>Provenance</h2>"
    yield html.table(
        ("", ""),
        [
            ("made", datetime.now(UTC).isoformat(timespec="seconds")),
            ("seed", seed),
            ("seconds of all cases", f"{sum(one.seconds for one in found):.0f}"),
            ("machine", f"{cpu_name()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}"),
            (
                "versions",
                ", ".join([f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in LIBRARIES)]),
            ),
        ],
        text_columns=2,
    )


def _theme(theme: str, found: Sequence[Found]) -> str:
    rows = [
        (
            one.case, one.could_break, one.decisive.quantity, f"{one.decisive.measured:.3g}", f"{one.decisive.bound:g}",
            len(one.measures), f"{one.seconds:.1f}", "ok" if one.ok else "OFF",
        )
        for one in found
    ]  # fmt: skip
    head = ("case", "what could break", "nearest to its bound", "measured", "bound", "measures", "seconds", "verdict")
    return f"<h2>{html.text(theme)}</h2>" + html.table(head, rows, text_columns=3, good=[one.ok for one in found])
