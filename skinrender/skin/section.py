"""section.png: a vertical cut through the volume where the lesion is darkest (as the paper's figure 5)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from skinrender.atomic import whole_file
from skinrender.skin.volume import SkinVolume

ZOOM_MM = 0.3
USUAL_BYTES = 50_000
"""Size of the file, whatever the volume."""
_PLACES = (0.07, 0.59, 0.915, 0.375), (0.07, 0.145, 0.915, 0.375), (0.07, 0.02, 0.915, 0.07)
"""Left, bottom, width and height of the cut, its upper part and the legend, as shares of the figure; letting matplotlib
find them takes a third of the drawing."""
_COLORS = {
    "air": "#ffffff",
    "stratum_corneum": "#e9d3a8",
    "granular_spinous": "#f2b98c",
    "basal": "#cf8f5a",
    "papillary": "#f7cfd0",
    "subpapillary": "#efb4b6",
    "upper_plexus": "#d9777c",
    "reticular": "#f3d9d2",
    "lower_plexus": "#c9676f",
    "subcutis": "#f6e6a0",
}
_INK_COLOR = "#20307a"
_SLAB_COLORS = ("#f3d9d2", "#c6d8ea", "#d3e6c4", "#ecdca8", "#d8c9e6", "#e8c4b8")


def draw_section(volume: SkinVolume, path: str | os.PathLike) -> None:
    """Write the section as PNG: the whole depth, and its upper 0.3 mm enlarged.

    Layers are told apart by color, melanin by darkness and ink by blue, relative to the most that the volume holds.

    Raises
    ------
    RunError : the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    row = darkest_row(volume)
    color = _entry_colors(volume)[volume.palette_index[:, row, :]].swapaxes(0, 1)
    figure = Figure(figsize=(10, 8), dpi=110)
    FigureCanvasAgg(figure)
    whole, zoom, legend = (figure.add_axes(place) for place in _PLACES)
    bottom = float(volume.z_edges_mm[-1])
    _draw_cut(whole, volume, color, bottom)
    _draw_cut(zoom, volume, color, min(ZOOM_MM, bottom))
    y_mm = (row + 0.5) * volume.size_mm[1] / volume.shape[1]
    whole.set_title(f"Section at y = {y_mm:.3g} mm; below, its upper part enlarged", fontsize=10)
    _draw_legend(legend, volume)
    with whole_file(path) as partial:
        figure.savefig(partial, format="png", metadata={"Software": "skinrender"})


def darkest_row(volume: SkinVolume) -> int:
    """Row of voxel columns that holds the column with the most melanin, or ink, over its depth.

    It is the middle one if all columns agree. Where melanin and ink both vary, each counts relative to its range.
    """
    height = np.diff(volume.z_edges_mm)
    total = np.zeros(volume.shape[:2])
    for content in (volume.palette_melanin, _ink(volume)):
        amount = np.stack([content[plane] @ height for plane in volume.palette_index])
        if np.ptp(amount) > 1e-3 * amount.max():
            total += (amount - amount.min()) / np.ptp(amount)
    if not total.any():
        return volume.shape[1] // 2
    return int(np.unravel_index(np.argmax(total), total.shape)[1])


def _ink(volume: SkinVolume) -> np.ndarray:
    """Volume fraction of all inks together (P,)."""
    if volume.palette_ink is None:
        return np.zeros(len(volume.palette_layer), np.float32)
    return volume.palette_ink.sum(axis=1)


def _entry_colors(volume: SkinVolume) -> np.ndarray:
    """RGB (P, 3) of the palette entries."""
    from matplotlib.colors import to_rgb

    base = np.array([to_rgb(_layer_color(i, name)) for i, name in enumerate(volume.layer_name)])
    melanin, ink = (_relative(content)[:, None] for content in (volume.palette_melanin, _ink(volume)))
    color = base[volume.palette_layer] * (1 - 0.9 * np.sqrt(melanin))
    return color + np.sqrt(ink) * (np.array(to_rgb(_INK_COLOR)) - color)


def _relative(content: np.ndarray) -> np.ndarray:
    return content / max(float(content.max()), 1e-9)


def _layer_color(index: int, name: str) -> str:
    return _COLORS.get(name, _SLAB_COLORS[index % len(_SLAB_COLORS)])


def _draw_cut(axes, volume: SkinVolume, color: np.ndarray, bottom_mm: float) -> None:
    last = int(np.searchsorted(volume.z_edges_mm, bottom_mm))
    x_mm = np.linspace(0, volume.size_mm[0], volume.shape[0] + 1)
    axes.pcolormesh(x_mm, volume.z_edges_mm[: last + 1], color[:last], rasterized=True)
    axes.set(xlim=(0, volume.size_mm[0]), ylim=(bottom_mm, float(volume.z_edges_mm[0])))
    axes.set_xlabel("x / mm")
    axes.set_ylabel("z / mm")


def _draw_legend(axes, volume: SkinVolume) -> None:
    from matplotlib.patches import Patch

    axes.axis("off")
    names = list(enumerate(volume.layer_name))[1:13]
    patches = [Patch(facecolor=_layer_color(i, name), edgecolor="0.4", label=name) for i, name in names]
    patches.append(Patch(facecolor="0.15", label=f"melanin, up to {volume.palette_melanin.max():.3g}"))
    for k, name in enumerate(volume.ink_name):
        label = f"ink {Path(name).name}, up to {volume.palette_ink[:, k].max():.3g}"
        patches.append(Patch(facecolor=_INK_COLOR, label=label))
    axes.legend(handles=patches, loc="center", ncols=5, fontsize=8, frameon=False)
