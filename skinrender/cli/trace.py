"""skinrender trace: the photon pass."""

from __future__ import annotations

from pathlib import Path

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import Shard, as_overrides, on_cluster, on_scene, reporting, tracing, with_workers


@click.command()
@on_scene
@tracing
@click.option("--shard", type=Shard(), help="Walk the i-th of n parts only, for `skinrender merge`.")
@with_workers
@on_cluster
@reporting
def trace(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    photons: int | None,
    seed: int | None,
    resume: bool,
    shard: tuple[int, int] | None,
    workers: int | None,
    scheduler: str | None,
    console: Console,
) -> None:
    """Trace photons through the volume of SCENE.

    Reads volume.npz, writes photons.npz. Ctrl-C keeps the rounds that are finished; --resume goes on from them.

    \b
    Example:
      skinrender trace configs/fig12_epidermal.yaml --photons 1e7 --seed 2
      skinrender trace configs/fig12_epidermal.yaml --photons 1e9 --shard 3/16 -o out/part3
      skinrender trace configs/fig12_epidermal.yaml --photons 1e9 --scheduler tcp://10.0.0.5:8786
    """
    from skinrender.cli.current import matching_volume
    from skinrender.cli.job import open_job
    from skinrender.cli.stages import run_trace, trace_rows

    job = open_job(scene_path, overrides + as_overrides(photons=photons, seed=seed), output, console)
    matching_volume(job)
    summary = run_trace(job, workers, resume, shard, scheduler)
    job.log_seconds("trace", workers)
    written = job.photons if shard is None else job.out / "rounds"
    summary |= {"files": [str(written)]}
    console.result(
        summary,
        [*trace_rows(summary, console.verbose), seconds_row(summary["seconds"]), ("wrote", str(written))],
    )
