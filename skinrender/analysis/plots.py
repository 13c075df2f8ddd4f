"""Figures in the style of all plots of the analysis; the one place there that knows matplotlib."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from skinrender.atomic import whole_file

INK, SOFT = "#3a2a24", "#8a7a72"
SERIES = ("#b5452c", "#2c6e8f", "#6a8f2c", "#8a4f9e", "#c08a1e", "#3f7d6b", "#7a7a7a", "#1f3b73")
"""Colors of lines, told apart also by the color-blind and in grey print by their markers."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


def new_figure(width_in: float, height_in: float, dpi: int = 150) -> Any:
    """An empty white matplotlib figure that lays itself out."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=dpi, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def plain(axes: Any, grid: str = "y") -> None:
    """No frame, a faint grid behind the data."""
    axes.grid(axis=grid, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def logarithmic(axis: Any) -> None:
    """Make an axis, of seconds and the like, logarithmic, with numbers as people write them."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def save(figure: Any, path: Path) -> None:
    """Write PNG or SVG, as the suffix says; raises `RunError` if it cannot be written."""
    data = as_bytes(figure, path.suffix[1:])
    with whole_file(path) as partial:
        partial.write_bytes(data)


def as_bytes(figure: Any, kind: str) -> bytes:
    """The figure as ``png`` or ``svg``; the same figure gives the same bytes."""
    from matplotlib import rc_context

    metadata = {"Software": "skinrender"} if kind == "png" else {"Date": None, "Creator": "skinrender"}
    data = io.BytesIO()
    with rc_context({"svg.hashsalt": "skinrender"}):
        figure.savefig(data, format=kind, metadata=metadata)
    return data.getvalue()
