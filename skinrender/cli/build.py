"""skinrender build: scene -> voxel volume."""

from __future__ import annotations

from pathlib import Path

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import on_scene, reporting


@click.command()
@on_scene
@reporting
def build(scene_path: Path, overrides: tuple[str, ...], output: Path | None, console: Console) -> None:
    """Build the voxel volume of SCENE.

    Writes volume.npz and section.png, a vertical cut through it.

    \b
    Example:
      skinrender build configs/fig12_epidermal.yaml --set lesions.0.melanin_scale=0.1
    """
    from skinrender.cli.job import open_job
    from skinrender.cli.stages import run_build, volume_rows, volume_summary

    job = open_job(scene_path, overrides, output, console)
    summary = volume_summary(job, run_build(job))
    summary |= {"seconds": job.clock.seconds, "files": [str(job.volume), str(job.section)]}
    console.result(
        summary,
        [*volume_rows(summary), seconds_row(summary["seconds"]), ("wrote", f"{job.volume}, {job.section.name}")],
    )
