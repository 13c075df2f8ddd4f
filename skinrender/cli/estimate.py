"""skinrender estimate: photon map -> picture."""

from __future__ import annotations

from pathlib import Path

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import as_overrides, estimating, on_cluster, on_scene, reporting, with_workers


@click.command()
@on_scene
@estimating
@with_workers
@on_cluster
@reporting
def estimate(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    method: str | None,
    gather_count: int | None,
    reflectance: bool,
    workers: int | None,
    scheduler: str | None,
    console: Console,
) -> None:
    """Estimate the picture of SCENE from its photon map.

    Reads volume.npz and photons.npz, writes <method>.exr (spectral, linear) and <method>.png (sRGB), and adds the
    seconds of each stage to timing.csv. index.html shows what is in the folder and how it was made.

    \b
    Example:
      skinrender estimate configs/fig12_epidermal.yaml --method point --gather-count 5000
    """
    from skinrender.cli.current import matching_map, matching_volume
    from skinrender.cli.job import open_job
    from skinrender.cli.stages import estimate_rows, run_estimate

    job = open_job(scene_path, overrides + as_overrides(method=method, gather_count=gather_count), output, console)
    with job.clock.stage("load"):
        volume, photon_map = matching_volume(job), matching_map(job)
    summary = run_estimate(job, volume, photon_map, reflectance, workers, scheduler)
    job.log_seconds("estimate", workers)
    job.write_page()
    summary |= {"seconds": job.clock.seconds, "files": [str(job.exr), str(job.png), str(job.page)]}
    console.result(
        summary,
        [
            *estimate_rows(summary),
            seconds_row(summary["seconds"]),
            ("wrote", f"{job.exr}, {job.png.name}, {job.page.name}"),
        ],
    )
