"""skinrender spectrum: diffuse reflectance and color of the skin, without a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinrender.cli.console import Console, Row, seconds_row, with_error
from skinrender.cli.options import Quantity, as_overrides, on_scene, reporting, with_workers


@click.command()
@on_scene
@click.option(
    "--stderr", type=Quantity(1e-5, 0.5), default=0.002, show_default=True,
    help="Relative standard error wanted of the reflectance, mean over the bands.",
)
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the photons.  [default: the scene's]")
@with_workers
@reporting
def spectrum(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    stderr: float,
    seed: int | None,
    workers: int | None,
    console: Console,
) -> None:
    """Measure SCENE's skin as a spectrophotometer does: light from 8 degrees, all that comes back.

    Writes spectrum.csv and spectrum.png. The scene's light, camera and sides are not read: parallel light falls on the
    whole patch, whose sides are periodic, and no photon is stored. On a scene with lesions: inside (the pattern is over
    half its maximum), outside (0) and their difference.

    \b
    Example:
      skinrender spectrum configs/fig10_forearm.yaml
      skinrender spectrum configs/fig12_epidermal.yaml --stderr 0.005 --json
    """
    from skinrender.analysis.spectrum import spectrum as measure
    from skinrender.analysis.spectrum_files import draw_spectrum, write_csv
    from skinrender.cli.job import open_job

    job = open_job(scene_path, overrides + as_overrides(seed=seed), output, console)
    found = measure(job.scene, stderr=stderr, workers=workers, progress=console.progress, clock=job.clock)
    table, plot = job.out / "spectrum.csv", job.out / "spectrum.png"
    with job.clock.stage("write"):
        write_csv(found, table)
        draw_spectrum(found, plot)
    job.log_seconds("spectrum", workers)
    summary = found.as_json() | {"seconds": job.clock.seconds, "files": [str(table), str(plot)]}
    console.result(
        summary,
        [*_rows(summary, console.verbose), seconds_row(summary["seconds"]), ("wrote", f"{table}, {plot.name}")],
    )


def _rows(summary: Mapping[str, Any], by_wavelength: bool) -> list[Row]:
    noise = f"{100 * summary['stderr_relative_mean']:.2g} % of the reflectance, mean over the bands"
    rows = [("photons", f"{summary['photons_emitted']} emitted"), ("standard error", noise)]
    rows += _color_rows(summary, "")
    for name, part in summary.get("regions", {}).items():
        rows += _color_rows(part, f" {name}")
    if by_wavelength:
        rows += [
            (f"reflectance at {nm:g} nm", f"{with_error(total)}; specular excluded {with_error(diffuse)}")
            for nm, total, diffuse in zip(
                summary["wavelength_nm"], summary["reflectance"], summary["specular_excluded"]
            )
        ]
    return rows


def _color_rows(part: Mapping[str, Any], where: str) -> list[Row]:
    rows = [(f"L*a*b* (D65, 2°){where}", ", ".join(with_error(value) for value in part["lab"].values()))]
    if part["ita_deg"] is not None:
        rows.append((f"ITA / degrees{where}", f"{with_error(part['ita_deg'])} ({part['ita_class']})"))
    indices = ((name.replace("_", " "), part[name]) for name in ("melanin_index", "erythema_index"))
    return rows + [(f"{name}{where}", with_error(pair)) for name, pair in indices if math.isfinite(pair["value"])]
