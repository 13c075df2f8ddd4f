"""skinrender report: error against run time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinrender.cli.console import Console, Row
from skinrender.cli.options import Count, Quantity, on_scenes, reporting, with_workers


@click.command()
@on_scenes
@click.option(
    "--method", "methods", multiple=True, metavar="METHOD[:K]", default=("beam", "point"), show_default=True,
    help="Radiance estimate: beam, point or reference, with a gather count if wanted; may be repeated.",
)
@click.option(
    "--photons", "counts", multiple=True, type=Count(),
    help="Photons to store; may be repeated.  [default: the scene's, and a 10th, a 100th, a 1000th of it]",
)
@click.option("--seeds", type=click.IntRange(1, 1000), default=3, show_default=True, help="Runs of each, by seed.")
@click.option(
    "--reference", "kind", type=click.Choice(["beam", "reference"]),
    help="Estimate of the reference picture.  [default: reference on flat scenes of one band, else beam]",
)
@click.option(
    "--reference-photons", type=Count(),
    help="Photons of the reference picture.  [default: 4 times the largest count by beam, 20 times by reference]",
)
@click.option(
    "--target-seconds", type=Quantity(0, min_open=True),
    help="Start no run that would probably end later; small counts come first, and what is left out is told.",
)
@with_workers
@reporting
def report(
    scene_paths: tuple[Path, ...],
    overrides: tuple[str, ...],
    output: Path | None,
    methods: tuple[str, ...],
    counts: tuple[int, ...],
    seeds: int,
    kind: str | None,
    reference_photons: int | None,
    target_seconds: float | None,
    workers: int | None,
    console: Console,
) -> None:
    """Report the error of SCENE's pictures against the time they take.

    Runs methods x photon counts x seeds, holds each picture against a reference, and writes report/index.html,
    error_vs_time.csv (.png, .svg) and table1.md. A run that is finished is kept: the same command goes on where it was,
    and more --photons or --seeds add to it.

    \b
    Example:
      skinrender report configs/slab_blue.yaml configs/fig12_epidermal.yaml --set camera.pixels=[64,64] \\
        --photons 1e4 --photons 1e5 --photons 1e6 --photons 1e7 --target-seconds 900 -o out/report
    """
    from skinrender.analysis.error_study import Method, Study, make_subjects
    from skinrender.analysis.report import report as make_report
    from skinrender.cli.job import command_line, make_folder
    from skinrender.scene import load_scene

    chosen = tuple(dict.fromkeys(Method.parse(text) for text in methods))
    subjects = make_subjects((load_scene(path, overrides), path) for path in scene_paths)
    study = Study(
        subjects, chosen, counts=counts or None, seeds=seeds, reference=kind, reference_photons=reference_photons,
        workers=workers, target_seconds=target_seconds,
    )  # fmt: skip
    name = subjects[0].scene.name if len(subjects) == 1 else "report"
    out = make_folder(output if output is not None else Path("out") / name)
    made = make_report(study, out, command=command_line(), progress=console.progress, detail=console.detail)
    summary = made.as_json()
    for line in summary["left_out"]:
        console.warn(f"left out, as the time was used up: {line}")
    console.result(summary, _rows(summary))


def _rows(summary: Mapping[str, Any]) -> list[Row]:
    rows = [("runs", f"{summary['runs']}, of them {summary['runs_new']} now")]
    for scene in summary["scenes"]:
        reference = scene["reference"]
        noise = f"{100 * reference['noise_relative']:.2g} % of a pixel"
        rows += [("", ""), (scene["scene"], f"reference by {reference['kind']}, {reference['photons']:.3g} photons, noise {noise}")]
        for series in scene["series"]:
            label = series["method"] + (f":{series['gather_count']}" if series["gather_count"] else "")
            rows += [(f"  {label}, {level['photons']:.3g} photons", _level(level)) for level in series["levels"]]
            rows.append((f"  {label}", series["verdict"]))
    return [*rows, ("", ""), ("wrote", ", ".join(summary["files"]))]


def _level(level: Mapping[str, Any]) -> str:
    error = level["relmse"]["stderr"]
    told = "" if error is None else f" ± {error:.2g}"
    efficiency = level["efficiency_per_s"]
    last = f", efficiency {efficiency:.3g} /s" if math.isfinite(efficiency) else ""
    return f"{level['seconds']['total']:.3g} s, relMSE {level['relmse']['value']:.3g}{told}, dE00 {level['delta_e_mean']:.3g}{last}"
