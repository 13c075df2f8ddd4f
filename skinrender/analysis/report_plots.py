"""The plots of a report: error and color noise against time, where the time goes, pictures beside each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from skinrender.analysis.error_levels import Level, Series
from skinrender.analysis.error_stats import noise_map
from skinrender.analysis.error_study import count_text
from skinrender.analysis.plots import INK, MARKERS, SERIES, SOFT, logarithmic, new_figure, plain
from skinrender.analysis.report_findings import Findings
from skinrender.film.color import encode_srgb

STAGE_COLORS = {"load": "#d8cfc4", "trace": "#e0a65a", "estimate": "#b5452c", "write": "#8a7a72"}
PANEL_IN = (5.0, 4.0)


def draw_errors(findings: Sequence[Findings]) -> Any:
    """relMSE against seconds, a panel a scene, a line a method, seeds as points, floors of bias as dashes."""
    figure, panels = _panels(findings)
    for axes, found in zip(panels, findings):
        for index, series in enumerate(found.series):
            _draw_series(axes, series, index)
        _log_log(axes, found, "relative mean square error of luminance")
    _legend(figure, panels, ncols=3)
    return figure


def draw_color_noise(findings: Sequence[Findings]) -> Any:
    """CIEDE2000 of a pixel against seconds: from the reference, and what noise alone makes."""
    figure, panels = _panels(findings)
    for axes, found in zip(panels, findings):
        for index, series in enumerate(found.series):
            seconds = [level.seconds["total"] for level in series.levels]
            style = {"color": _color(index), "marker": MARKERS[index % len(MARKERS)], "markersize": 5}
            axes.plot(seconds, _means(series, "delta_e_mean"), **style, label=f"{series.method.label}: mean")
            axes.plot(
                seconds, _means(series, "delta_e_p95"), color=_color(index), linewidth=0.9, linestyle=":",
                label=f"{series.method.label}: 95th percentile",
            )  # fmt: skip
            noise = [level.delta_e_noise for level in series.levels]
            if np.isfinite(noise).any():
                axes.plot(
                    seconds, noise, **(style | {"markerfacecolor": "white"}), linestyle="--", linewidth=0.9,
                    label=f"{series.method.label}: noise alone",
                )  # fmt: skip
        axes.axhline(
            found.reference.color_noise, color=SOFT, linewidth=1.0, linestyle=(0, (6, 2, 1, 2)), label="noise of the reference"
        )
        _log_log(axes, found, "CIEDE2000 of a pixel")
        logarithmic(axes.yaxis)
    _legend(figure, panels, ncols=3)
    return figure


def draw_stages(findings: Sequence[Findings]) -> Any:
    """Shares of the stages in each run's seconds, beside their total."""
    bars = [(found, series, level) for found in findings for series in found.series for level in series.levels]
    figure = new_figure(8.5, 1.1 + 0.24 * len(bars) + 0.3 * len(findings))
    panels = figure.subplots(
        len(findings), 1, squeeze=False, sharex=True,
        height_ratios=[sum(len(series.levels) for series in found.series) + 0.8 for found in findings],
    )  # fmt: skip
    for axes, found in zip(panels[:, 0], findings):
        _draw_bars(axes, found)
    panels[-1, 0].set_xlabel("share of the total / %", color=INK)
    _legend(figure, panels[:1, 0], ncols=4)
    return figure


def draw_pictures(found: Findings) -> Any:
    """The reference and each method's picture at nearly equal time; below, their signed differences from the reference."""
    shown, reference = found.shown, found.reference
    height, width = reference.halves[0].shape
    figure = new_figure(2.6 * (len(shown) + 1) + 1.0, 5.2 * height / width + 0.8)
    figure.set_layout_engine("compressed")
    top, bottom = figure.subplots(2, len(shown) + 1, squeeze=False)
    by = "" if reference.kind == "reference" else f", by {reference.kind}"
    _picture(top[0], encode_srgb(reference.image.display_rgb())[0], f"reference{by}")
    limit = _difference_limit(found)
    drawn = _difference(bottom[0], noise_map(reference.halves), limit, f"noise of the reference, rms {100 * reference.noise:.2g} %")
    for picture, above, below in zip(shown, top[1:], bottom[1:]):
        title = f"{picture.series.method.label}, {picture.row.total_s:.3g} s"
        _picture(above, encode_srgb(picture.image.display_rgb())[0], title)
        _difference(below, picture.difference, limit, f"rms {100 * picture.rms:.3g} %, {count_text(picture.row.photons)} photons")
    bar = figure.colorbar(drawn, ax=list(bottom), aspect=22, extend="both")
    bar.set_label("(picture − reference) / reference / %", color=INK, fontsize=8)
    bar.ax.tick_params(labelsize=8)
    return figure


def _panels(findings: Sequence[Findings]) -> tuple[Any, Sequence[Any]]:
    columns = min(2, len(findings))
    rows = -(-len(findings) // columns)
    figure = new_figure(max(6.2, PANEL_IN[0] * columns), PANEL_IN[1] * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(findings) :]:
        axes.axis("off")
    return figure, panels


def _legend(figure: Any, panels: Sequence[Any], ncols: int) -> None:
    """One for all panels, below them."""
    handles = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels())
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=ncols, frameon=False, fontsize=8)


def _draw_series(axes: Any, series: Series, index: int) -> None:
    color, marker = _color(index), MARKERS[index % len(MARKERS)]
    levels = [level for level in series.levels if level.relmse.value > 0]
    seconds = [level.seconds["total"] for level in levels]
    values = [level.relmse.value for level in levels]
    below = [value - max(level.relmse.interval[0], 0.05 * value) for level, value in zip(levels, values)]
    above = [level.relmse.interval[1] - value for level, value in zip(levels, values)]
    bars = np.nan_to_num(np.maximum([below, above], 0.0))
    axes.errorbar(
        seconds, values, yerr=bars, color=color, marker=marker, markersize=5, linewidth=1.6, elinewidth=0.8, capsize=2,
        label=series.method.label,
    )  # fmt: skip
    rows = [row for level in series.levels for row in level.rows if row.relmse > 0]
    axes.plot(
        [row.total_s for row in rows], [row.relmse for row in rows], linestyle="none", marker=marker, markersize=3,
        color=color, alpha=0.35, markeredgewidth=0,
    )  # fmt: skip
    if series.floor_is_seen:
        axes.axhline(
            series.floor.value, color=color, linewidth=1.0, linestyle="--", label=f"{series.method.label}: bias squared"
        )
    elif series.floor is not None and math.isfinite(series.floor.stderr) and series.floor.interval[1] > 0:
        axes.axhline(
            series.floor.interval[1], color=color, linewidth=0.9, linestyle=":",
            label=f"{series.method.label}: bias squared is below (95 %)",
        )  # fmt: skip


def _log_log(axes: Any, found: Findings, quantity: str) -> None:
    logarithmic(axes.xaxis)
    axes.set_yscale("log")
    axes.set_title(found.subject.label, loc="left", color=INK, fontsize=11, parse_math=False)
    axes.set_xlabel("total time / s", color=INK)
    axes.set_ylabel(quantity, color=INK)
    plain(axes, "both")


def _draw_bars(axes: Any, found: Findings) -> None:
    names, row = [], 0
    for series in found.series:
        for level in series.levels:
            _draw_bar(axes, row, level)
            names.append(f"{series.method.label}, {count_text(level.photons)} photons")
            row += 1
    axes.set_yticks(range(row), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(0, 112)
    axes.set_title(found.subject.label, loc="left", color=INK, fontsize=10, parse_math=False)
    plain(axes, "x")


def _draw_bar(axes: Any, row: int, level: Level) -> None:
    seconds, left = level.seconds, 0.0
    for stage, color in STAGE_COLORS.items():
        share = 100 * seconds[stage] / seconds["total"]
        axes.barh(row, share, left=left, color=color, height=0.72, label=stage if row == 0 else None)
        left += share
    axes.text(101, row, f"{seconds['total']:.3g} s", va="center", fontsize=8, color=INK)


def _picture(axes: Any, pixels: np.ndarray, title: str) -> None:
    axes.imshow(pixels, interpolation="nearest")
    axes.set_title(title, fontsize=9, color=INK)
    _no_ticks(axes)


def _difference(axes: Any, relative: np.ndarray, limit: float, title: str) -> Any:
    drawn = axes.imshow(100 * relative, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_title(title, fontsize=9, color=INK)
    _no_ticks(axes)
    return drawn


def _no_ticks(axes: Any) -> None:
    axes.set_xticks([])
    axes.set_yticks([])


def _difference_limit(found: Findings) -> float:
    """Where the color bar ends, percent: twice what most pixels of the best picture keep to; worse ones go beyond."""
    differences = [np.abs(picture.difference[np.isfinite(picture.difference)]) for picture in found.shown]
    return max(1e-6, 200 * min((float(np.percentile(d, 98)) for d in differences if d.size), default=0.0))


def _means(series: Series, column: str) -> list[float]:
    return [level.mean(column) for level in series.levels]


def _color(index: int) -> str:
    return SERIES[index % len(SERIES)]


