"""skinrender render: the three stages in order, doing again only what changed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import as_overrides, estimating, on_scene, reporting, tracing, with_workers

if TYPE_CHECKING:
    from skinrender.cli.job import Job


@click.command()
@on_scene
@tracing
@estimating
@with_workers
@reporting
def render(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    photons: int | None,
    seed: int | None,
    resume: bool,
    method: str | None,
    gather_count: int | None,
    reflectance: bool,
    workers: int | None,
    console: Console,
) -> None:
    """Build, trace and estimate SCENE, doing again only what changed.

    \b
    Example:
      skinrender render configs/fig12_epidermal.yaml
      skinrender render configs/fig12_epidermal.yaml --photons 1e6 --set camera.cross_polarized=true -o out/quick
    """
    from skinrender.cli.job import open_job
    from skinrender.cli.stages import estimate_rows

    options = as_overrides(photons=photons, seed=seed, method=method, gather_count=gather_count)
    job = open_job(scene_path, overrides + options, output, console)
    summary = _render(job, reflectance, workers, resume)
    rows = estimate_rows(summary)
    rows.append(("photons stored", str(summary["photons_stored"])))
    rows.append(("done", ", ".join(summary["stages_run"]) or "nothing: everything is up to date"))
    console.result(summary, [*rows, seconds_row(summary["seconds"]), ("picture", f"{job.exr}, {job.png.name}")])


def _render(job: Job, reflectance: bool, workers: int | None, resume: bool) -> dict[str, Any]:
    """Run the stages that are needed; the summaries of all three in one."""
    from skinrender.cli.current import current_map, current_summary, current_volume, estimate_provenance, matching_map
    from skinrender.cli.stages import run_build, run_estimate, run_trace, volume_summary
    from skinrender.engine.trace import summary_of_map

    done = []
    with job.clock.stage("load"):
        volume = current_volume(job)
    if volume is None:
        done.append("build")
        volume = run_build(job)
    summary = volume_summary(job, volume)
    with job.clock.stage("load"):
        photon_map = current_map(job)
    if photon_map is None:
        done.append("trace")
        summary |= run_trace(job, workers, resume)
        with job.clock.stage("load"):
            photon_map = matching_map(job)
    else:
        summary |= summary_of_map(photon_map).as_json()
    picture = current_summary(job, estimate_provenance(job, photon_map, reflectance))
    if picture is None:
        done.append("estimate")
        picture = run_estimate(job, volume, photon_map, reflectance, workers)
    if done:
        job.log_seconds("render", workers)
    files = [job.volume, job.section, job.photons, job.exr, job.png]
    return summary | picture | {
        "stages_run": done, "seconds": job.clock.seconds, "files": [str(file) for file in files]
    }  # fmt: skip
