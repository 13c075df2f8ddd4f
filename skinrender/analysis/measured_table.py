"""Skin beside measured skin: python -m skinrender.analysis.measured_table (make measured-skin).

Walks the presets of both sites and of the tones, and writes what the spectra and colors differ by: measured_skin.md,
measured_skin.csv and measured_skin.png.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinrender.analysis.spectrum import SkinSpectrum, spectrum
from skinrender.analysis.spectrum_files import draw_comparisons
from skinrender.analysis.tool import options, tool
from skinrender.atomic import whole_file
from skinrender.film.color import delta_e, lab_of_factor
from skinrender.optics.measured_skin import TONES
from skinrender.scene import load_scene

SITES = {"forearm": "configs/fig10_forearm.yaml", "cheek": "configs/cheek.yaml"}
LAST_NM = 660.0
"""Beyond, contact heads lose red light sideways, as far as their port is small."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A spectrum beside the measured table of its preset; W wavelengths that were measured.

    Parameters
    ----------
    found : the spectrum.
    wavelength_nm, mean, sd : (W,) measured.
    deviation : (W,) of the spectrum, in standard deviations over subjects.
    delta_e : CIEDE2000 between the colors of the two over these wavelengths.
    outside_nm : wavelengths at which no subject was so dark, or so light; empty where the extremes are not known.
    """

    found: SkinSpectrum
    wavelength_nm: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    deviation: np.ndarray
    delta_e: float
    outside_nm: np.ndarray

    @property
    def largest_deviation(self) -> float:
        """Largest deviation from 400 to 660 nm."""
        used = (self.wavelength_nm >= 400.0) & (self.wavelength_nm <= LAST_NM)
        return float(np.abs(self.deviation[used]).max())


def compared(found: SkinSpectrum) -> Comparison:
    """Hold a spectrum against its measured table, which it must have."""
    nm, m = found.wavelength_nm, found.measured
    mean, sd = m.on_bands(nm)
    known = np.isfinite(mean)
    nm, mean, sd, total = nm[known], mean[known], sd[known], found.patch.total[known]
    outside = np.zeros(nm.size, bool)
    if m.least is not None:
        outside = (total < np.interp(nm, m.wavelength_nm, m.least)) | (total > np.interp(nm, m.wavelength_nm, m.largest))
    color = delta_e(lab_of_factor(total, nm), lab_of_factor(mean, nm))
    return Comparison(found, nm, mean, sd, (total - mean) / sd, float(color), nm[outside])


def write_table(comparisons: Iterable[Comparison], path: Path) -> None:
    """Markdown: a line for each preset."""
    lines = [
        "| preset | measured | L\\*a\\*b\\* | measured | ΔE00 | largest deviation 400-660 nm / SD | nm outside all subjects |",
        "|---|---|---|---|---|---|---|",
    ]
    for c in comparisons:
        labs = [lab_of_factor(r, c.wavelength_nm) for r in (c.mean + c.deviation * c.sd, c.mean)]
        ours, theirs = (" ".join(f"{value:.1f}" for value in lab) for lab in labs)
        outside = ", ".join(f"{nm:g}" for nm in c.outside_nm) or "none" if c.found.measured.least is not None else "–"
        lines.append(
            f"| {c.found.name} | {c.found.measured.name} | {ours} | {theirs} | {c.delta_e:.2f} "
            f"| {c.largest_deviation:.2f} | {outside} |"
        )
    with whole_file(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_deviations(comparisons: Iterable[Comparison], path: Path) -> None:
    """CSV: a line for each preset and wavelength."""
    with whole_file(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["preset", "wavelength_nm", "reflectance", "measured_mean", "measured_sd", "deviation_sd"])
        for c in comparisons:
            reflectance = c.mean + c.deviation * c.sd
            for row in zip(c.wavelength_nm, reflectance, c.mean, c.sd, c.deviation):
                writer.writerow([c.found.name, *(f"{value:.5g}" for value in row)])


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Walk the presets and write the comparison."""
    parser = options(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/measured_skin"), help="folder to write to")
    parser.add_argument("--stderr", type=float, default=0.004, help="relative standard error of the reflectances")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change the scenes")
    wanted = parser.parse_args(arguments)
    wanted.output.mkdir(parents=True, exist_ok=True)
    presets = [(site, path, []) for site, path in SITES.items()]
    presets += [(f"forearm, {tone.replace('_', ' ')}", SITES["forearm"], [f"skin.tone={tone}"]) for tone in TONES]
    comparisons = []
    for name, path, overrides in presets:
        scene = load_scene(path, ["bands_nm.step=10", f"name={name}", *overrides, *wanted.set])
        comparisons.append(compared(spectrum(scene, stderr=wanted.stderr, progress=True)))
    write_table(comparisons, wanted.output / "measured_skin.md")
    write_deviations(comparisons, wanted.output / "measured_skin.csv")
    draw_comparisons([c.found for c in comparisons], wanted.output / "measured_skin.png")
    print((wanted.output / "measured_skin.md").read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    sys.exit(main())
