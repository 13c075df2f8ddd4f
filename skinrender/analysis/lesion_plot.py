"""Plots of the lesion table: color against depth, and the depth that light reaches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinrender.analysis.lesion_sweep import Row
from skinrender.analysis.light_depth import QUANTILES, LightDepth
from skinrender.analysis.plots import INK, SOFT, new_figure, save
from skinrender.analysis.spectrum_files import skin_rgb

_MARKERS = {"epidermal": "^", "dermal": "o", "mole": "D"}
_TICKS_MM = (0.06, 0.1, 0.2, 0.4, 0.8)


def draw_table(table: Sequence[Row], path: Path) -> None:
    """dL*, da*, db* against the mean depth of the pigment, each mark in the color of its lesion."""
    figure = new_figure(12, 4.6, dpi=120)
    for axes, axis, k in zip(figure.subplots(1, 3), ("L", "a", "b"), range(3)):
        axes.axhline(0, color=SOFT, linewidth=0.8)
        for row in table:
            color = np.clip(skin_rgb(row.found.patch, row.found.wavelength_nm), 0, 1)
            size = 26 * (1 + max(0.0, np.log10(row.amount_um / 0.1)))
            axes.scatter(
                row.depth_mm, row.lab[k], s=size, color=[color], edgecolor=INK, linewidth=0.6,
                marker=_MARKERS.get(row.kind, "s"), zorder=3,
            )  # fmt: skip
        axes.set(xscale="log", xlabel="mean depth of the pigment / mm", title=f"Δ{axis}*")
        axes.set_xticks(_TICKS_MM, [f"{depth:g}" for depth in _TICKS_MM])
        axes.minorticks_off()
        axes.grid(alpha=0.25)
    _legend(figure)
    save(figure, path)


def draw_light_depth(found: LightDepth, path: Path) -> None:
    """Mean and quartiles of the greatest depth against the wavelength, depth downwards."""
    figure = new_figure(7, 4.6, dpi=120)
    axes = figure.add_subplot()
    low, middle, high = (found.quantile_mm(q) for q in QUANTILES)
    axes.fill_between(found.wavelength_nm, low, high, color="#e8c9b8", label="middle half of the light")
    axes.plot(found.wavelength_nm, middle, color=SOFT, label="median")
    axes.plot(found.wavelength_nm, found.mean_mm, color=INK, marker="o", markersize=3, label="mean")
    axes.set(xlabel="wavelength / nm", ylabel="greatest depth below the surface / mm")
    axes.set_title("How deep the light has been that forearm returns", fontsize=10)
    axes.set_xlim(found.wavelength_nm[0], found.wavelength_nm[-1])
    axes.set_ylim(float(found.depth_mm[-1]), 0)
    axes.legend(frameon=False, loc="lower left")
    save(figure, path)


def _legend(figure) -> None:
    names = {"^": "epidermal", "o": "dermal", "D": "mole", "s": "tattoo"}
    style = {"linestyle": "", "markerfacecolor": "white", "markeredgecolor": INK}
    marks = [figure.axes[0].plot([], [], marker=marker, label=name, **style)[0] for marker, name in names.items()]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, title="larger: more pigment")
