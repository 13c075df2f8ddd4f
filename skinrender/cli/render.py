"""skinrender render: the three stages in order, doing again only what changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import (
    Quantity,
    as_overrides,
    estimating,
    on_cluster,
    on_scene,
    reporting,
    tracing,
    with_workers,
)

if TYPE_CHECKING:
    from skinrender.cli.job import Job
    from skinrender.skin.volume import SkinVolume


@click.command()
@on_scene
@tracing
@estimating
@click.option(
    "--target-error", type=Quantity(min=0, min_open=True, max=1), metavar="E",
    help="Go on until the noise of a pixel is at most E of its luminance, mean over the picture, e.g. 0.02.",
)
@click.option(
    "--time", "seconds", type=Quantity(min=0, min_open=True), metavar="S",
    help="Make the best picture that is there within S seconds.",
)
@with_workers
@on_cluster
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
    target_error: float | None,
    seconds: float | None,
    workers: int | None,
    scheduler: str | None,
    console: Console,
) -> None:
    """Build, trace and estimate SCENE, doing again only what changed. index.html in its folder shows what was made.

    With --target-error or --time the photons go straight into the picture, which grows until it is good enough or its
    time is over; no photon map is written, and the picture so far is always there.

    \b
    Example:
      skinrender render configs/fig12_epidermal.yaml
      skinrender render configs/fig12_epidermal.yaml --photons 1e6 --set camera.cross_polarized=true -o out/quick
      skinrender render configs/fig12_epidermal.yaml --target-error 0.02
    """
    from skinrender.cli.job import open_job
    from skinrender.cli.stages import estimate_rows

    growing = target_error is not None or seconds is not None
    if growing and (photons is not None or resume or scheduler is not None):
        raise click.UsageError("--target-error and --time go without --photons, --resume and --scheduler.")
    options = as_overrides(photons=photons, seed=seed, method=method, gather_count=gather_count)
    job = open_job(scene_path, overrides + options, output, console)
    if growing:
        summary = _render_until(job, target_error, seconds, reflectance, workers)
    else:
        summary = _render(job, reflectance, workers, resume, scheduler)
    rows = estimate_rows(summary)
    rows.append(("photons looked at" if growing else "photons stored", str(summary["photons_stored"])))
    rows.append(("done", ", ".join(summary["stages_run"]) or "nothing: everything is up to date"))
    console.result(
        summary,
        [*rows, seconds_row(summary["seconds"]), ("picture", f"{job.exr}, {job.png.name}"), ("page", str(job.page))],
    )


def _render(
    job: Job, reflectance: bool, workers: int | None, resume: bool, scheduler: str | None
) -> dict[str, Any]:
    """Run the stages that are needed; the summaries of all three in one."""
    from skinrender.cli.current import current_map, current_summary, estimate_provenance, matching_map
    from skinrender.cli.stages import run_build, run_estimate, run_trace, volume_summary
    from skinrender.engine.ahead import kernels_ahead
    from skinrender.engine.trace import summary_of_map

    done, volume = _volume(job, run_build)
    summary = volume_summary(job, volume)
    with job.clock.stage("load"):
        photon_map = current_map(job)
    if photon_map is None:
        done.append("trace")
        with kernels_ahead(job.scene, job.volume) as compiled:
            summary |= run_trace(job, workers, resume, scheduler=scheduler)
            with job.clock.stage("load"):
                compiled()
                photon_map = matching_map(job, just_made=True)
    else:
        summary |= summary_of_map(photon_map).as_json()
    picture = current_summary(job, estimate_provenance(job, photon_map.provenance, reflectance))
    if picture is None:
        done.append("estimate")
        picture = run_estimate(job, volume, photon_map, reflectance, workers, scheduler)
    if done:
        job.log_seconds("render", workers)
    if done or not job.page.is_file():
        job.write_page()
    files = [job.volume, job.section, job.photons, job.exr, job.png, job.page]
    return summary | picture | {
        "stages_run": done, "seconds": job.clock.seconds, "files": [str(file) for file in files]
    }  # fmt: skip


def _render_until(
    job: Job, target_error: float | None, seconds: float | None, reflectance: bool, workers: int | None
) -> dict[str, Any]:
    """Build if need be, then let the picture grow."""
    from skinrender.cli.stages import build_alone, run_until, volume_summary

    done, volume = _volume(job, build_alone)
    summary = volume_summary(job, volume) | run_until(job, volume, target_error, seconds, reflectance, workers)
    job.log_seconds("render", workers)
    job.write_page()
    files = [job.volume, job.section, job.exr, job.png, job.page]
    return summary | {
        "stages_run": [*done, "trace", "estimate"], "seconds": job.clock.seconds, "files": [str(file) for file in files]
    }  # fmt: skip


def _volume(job: Job, build: Callable[[Job], SkinVolume]) -> tuple[list[str], SkinVolume]:
    """The scene's volume, and whether it had to be built."""
    from skinrender.cli.current import current_volume

    with job.clock.stage("load"):
        volume = current_volume(job)
    return ([], volume) if volume is not None else (["build"], build(job))
