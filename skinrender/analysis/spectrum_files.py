"""spectrum.csv and spectrum.png."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinrender.analysis.plots import INK, SOFT, new_figure, plain, save
from skinrender.analysis.spectrum import Reflectance, SkinSpectrum
from skinrender.atomic import whole_file
from skinrender.film.color import encode_srgb, exposure_for, rgb_matrix
from skinrender.optics.illuminants import band_weights

_MEASURED = "#d9a58c"
_CONFIDENT = 1.96


def write_csv(found: SkinSpectrum, path: Path) -> None:
    """One row a band; the columns of regions and of the measured table are there where these are."""
    columns = {"wavelength_nm": found.wavelength_nm}
    parts = {"": found.patch, "_inside": found.inside, "_outside": found.outside, "_difference": found.difference}
    for suffix, part in parts.items():
        if part is not None:
            columns |= {
                f"reflectance{suffix}": part.total,
                f"stderr{suffix}": part.total_stderr,
                f"reflectance_specular_excluded{suffix}": part.diffuse,
                f"stderr_specular_excluded{suffix}": part.diffuse_stderr,
            }
    if found.measured is not None:
        mean, sd = found.measured.on_bands(found.wavelength_nm)
        columns |= {"measured_mean": mean, "measured_sd": sd}
    with whole_file(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values()):
            writer.writerow([f"{value:.6g}" if np.isfinite(value) else "" for value in row])


def draw_spectrum(found: SkinSpectrum, path: Path) -> None:
    """The curve with its error, the measured mean +-1 SD behind it; raises `RunError` if it cannot be written."""
    figure = new_figure(8, 5)
    axes = figure.add_subplot()
    _draw_measured(axes, found)
    if found.inside is None:
        _draw_curve(axes, found, found.patch, "this scene")
    else:
        _draw_curve(axes, found, found.outside, "outside the lesion")
        _draw_curve(axes, found, found.inside, "inside the lesion")
    _finish(axes, found)
    save(figure, path)


def draw_comparisons(spectra: Sequence[SkinSpectrum], path: Path) -> None:
    """Several spectra with their measured bands, side by side; raises `RunError` if it cannot be written."""
    columns = min(4, len(spectra))
    rows = -(-len(spectra) // columns)
    figure = new_figure(3.4 * columns, 2.9 * rows, dpi=130)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, found in zip(panels, spectra):
        _draw_measured(axes, found)
        _draw_curve(axes, found, found.patch, "this scene")
        axes.set_title(found.name, loc="left", color=INK, fontsize=11)
        plain(axes)
        axes.set(xlim=(found.wavelength_nm[0], found.wavelength_nm[-1]), ylim=(0.0, 0.75))
    for axes in panels[len(spectra) :]:
        axes.axis("off")
    figure.supxlabel("wavelength / nm", color=INK, fontsize=11)
    figure.supylabel("reflectance, 8°/hemispherical", color=INK, fontsize=11)
    figure.suptitle("Presets in their own colors over measured means ± 1 SD", color=INK, fontsize=13)
    save(figure, path)


def _draw_measured(axes, found: SkinSpectrum) -> None:
    if found.measured is None:
        return
    m = found.measured
    axes.fill_between(
        m.wavelength_nm, m.mean - m.sd, m.mean + m.sd, color=_MEASURED, alpha=0.35, linewidth=0,
        label=f"{m.name}, mean ± 1 SD ({m.source})",
    )  # fmt: skip
    axes.plot(m.wavelength_nm, m.mean, color=_MEASURED, linewidth=1.2)


def _draw_curve(axes, found: SkinSpectrum, part: Reflectance, label: str) -> None:
    nm = found.wavelength_nm
    color = skin_rgb(part, nm)
    marks = {"marker": "o", "markersize": 5} if len(nm) < 20 else {}
    axes.plot(nm, part.total, color=INK, linewidth=2.6, **marks, solid_capstyle="round")
    axes.plot(nm, part.total, color=color, linewidth=1.5, **marks, solid_capstyle="round")
    error = _CONFIDENT * part.total_stderr
    axes.fill_between(nm, part.total - error, part.total + error, color=INK, alpha=0.25, linewidth=0)
    lab, ita = part.color.lab, part.color.ita_deg
    angle = f", ITA {ita[0]:.0f}°" if ita else ""
    told = f"{label}: L* {lab[0]:.1f}, a* {lab[1]:.1f}, b* {lab[2]:.1f}{angle}"
    axes.plot([], [], color=color, linewidth=6, label=told)
    axes.plot(nm, part.diffuse, color=SOFT, linewidth=1.0, linestyle=(0, (4, 2)))


def _finish(axes, found: SkinSpectrum) -> None:
    nm = found.wavelength_nm
    axes.plot([], [], color=SOFT, linewidth=1.0, linestyle=(0, (4, 2)), label="the same, specular excluded")
    axes.set_title(f"Diffuse reflectance of {found.name}", loc="left", color=INK, fontsize=13, pad=12)
    axes.set_xlabel("wavelength / nm", color=INK)
    axes.set_ylabel("reflectance, 8°/hemispherical, perfect white = 1", color=INK)
    if len(nm) > 1:
        axes.set_xlim(nm[0], nm[-1])
    axes.set_ylim(bottom=0.0)
    plain(axes)
    axes.legend(loc="upper left", frameon=False, fontsize=9)
    top = max(part.total.max() for part in (found.patch, found.inside, found.outside) if part is not None)
    if found.measured is not None:
        top = max(top, (found.measured.mean + found.measured.sd).max())
    axes.set_ylim(0.0, 1.3 * top if top > 0 else 1.0)
    axes.text(
        1.0, 1.02, f"L*a*b* under D65, 2° observer, specular included\nshaded: 95 % confidence, on average ± {100 * _CONFIDENT * found.stderr_relative_mean:.2g} %",
        transform=axes.transAxes, ha="right", va="bottom", fontsize=7.5, color=SOFT,
    )  # fmt: skip


def skin_rgb(part: Reflectance, wavelength_nm: np.ndarray) -> np.ndarray:
    """sRGB, 0 to 1, of the skin beside a perfect white."""
    light = band_weights("D65", wavelength_nm)
    to_rgb = rgb_matrix(wavelength_nm, light, exposure_for(light, wavelength_nm))
    return encode_srgb(light * part.total / np.pi @ to_rgb)[0] / 255.0
