"""skinrender plan: what a scene needs and what it will take, before any of it is made."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from skinrender.cli.console import Console, Row, seconds_row
from skinrender.cli.options import Count, as_overrides, on_scene, reporting, with_workers
from skinrender.files import bytes_text


@click.command()
@on_scene
@click.option("--photons", type=Count(), help="Photons to store, e.g. 1e7.  [default: the scene's]")
@click.option("--method", type=click.Choice(["beam", "point"]), help="Radiance estimate.  [default: the scene's]")
@with_workers
@reporting
def plan(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    photons: int | None,
    method: str | None,
    workers: int | None,
    console: Console,
) -> None:
    """Say what SCENE needs, what is left out and why, and predict photons, bytes and seconds. Writes nothing.

    -o names the folder whose disk is looked at; -v also tells what the numbers rest on.

    \b
    Example:
      skinrender plan configs/fig10_forearm.yaml --photons 3.24e8 --method point
    """
    from skinrender.engine.plan import make_plan
    from skinrender.scene import load_scene
    from skinrender.skin.memory import available_bytes

    scene = load_scene(scene_path, overrides + as_overrides(photons=photons, method=method))
    room = {"disk_free": _free(output or Path("out")), "memory_free": available_bytes()}
    summary = make_plan(scene, workers=workers).as_json()
    summary["bytes"] |= room
    for need, free in (("disk_peak", "disk_free"), ("memory", "memory_free")):
        if summary["bytes"][need] > summary["bytes"][free]:
            told = f"{bytes_text(summary['bytes'][need])} are needed, {bytes_text(summary['bytes'][free])} are free"
            console.warn(f"{need.partition('_')[0]}: {told}")
    console.result(summary, _rows(summary, console.verbose))


def _free(folder: Path) -> int:
    """Room on the disk that holds the folder, or would."""
    folder = folder.absolute()
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def _rows(summary: Mapping[str, Any], verbose: bool) -> Iterator[Row]:
    for used in (True, False):
        yield ("used" if used else "left out"), ""
        yield from ((f"  {row['feature']}", row["reason"]) for row in summary["features"] if row["used"] is used)
    stored, emitted = summary["photons_stored"], summary["photons_emitted"]
    size, memory = summary["bytes"], summary["memory_by_stage"]
    yield "voxels", f"{' x '.join(map(str, summary['voxels']))} in {bytes_text(size['volume'])}"
    yield "photons", f"{stored:.3g} stored of {emitted:.3g} emitted, in {summary['rounds']} rounds"
    yield "photons.npz", bytes_text(size["photons"])
    yield "disk", f"at most {bytes_text(size['disk_peak'])}, of {bytes_text(size['disk_free'])} free"
    told = ", ".join(f"{stage} {bytes_text(count)}" for stage, count in memory.items())
    yield "memory", f"{told}, of {bytes_text(size['memory_free'])} free"
    yield seconds_row(summary["seconds"])
    if verbose:
        yield from (("rests on", text) for text in summary["assumptions"])
