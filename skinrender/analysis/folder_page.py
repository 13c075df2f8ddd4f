"""``index.html``: what lies in the folder of a scene, how it was made, and how long that took."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from skinrender.analysis.html_page import figure, page, table, text
from skinrender.atomic import whole_file
from skinrender.engine.view import METHODS
from skinrender.errors import InputError
from skinrender.film.exr import read_provenance

STAGES = ("load", "trace", "estimate", "write", "total")
WIDTH_PX = 480
WHAT = {
    "<method>.exr": "the picture: spectral radiance by band in W m⁻² sr⁻¹, linear RGB, standard error of the luminance",
    "<method>.png": "the same in sRGB",
    "volume.npz": "voxels and their optics",
    "section.png": "a vertical cut through the volume where it is darkest",
    "photons.npz": "the photon map; a picture by another method or camera needs no new one",
    "spectrum.csv": "reflectance by band with its standard error",
    "spectrum.png": "the same as a plot",
    "timing.csv": "seconds of each stage of each run, with the machine",
}


def write_folder_page(path: Path, scene: Any, command: str) -> None:
    """Write the page of what is in a folder now.

    Parameters
    ----------
    path : of the page, in the folder where a scene's files are.
    scene : the scene (`skinrender.scene.Scene`) that they belong to.
    command : the command line that made them.

    Raises
    ------
    RunError : it cannot be written.
    """
    folder, parts = path.parent, [f"<h1>{text(scene.name)}</h1>"]
    if scene.description:
        parts.append(f'<p class="lead">{text(scene.description)}</p>')
    parts += [*_pictures(folder), *_seconds(folder), *_files(folder), *_origin(scene, command)]
    with whole_file(path) as partial:
        partial.write_text(page(scene.name, parts), encoding="utf-8")


def _pictures(folder: Path) -> Iterator[str]:
    for method in METHODS:
        picture = folder / f"{method}.png"
        if not picture.is_file():
            continue
        try:
            provenance = read_provenance(picture.with_suffix(".exr"))
        except InputError:
            continue  # the PNG of a run that was killed, or a spectral picture that is damaged: nothing is known of it
        yield figure(picture.read_bytes(), "png", _caption(method, provenance), f"picture by {method}", WIDTH_PX)
    for name in ("section.png", "spectrum.png"):
        if (folder / name).is_file():
            yield figure((folder / name).read_bytes(), "png", f"{name}: {WHAT[name]}", name)


def _caption(method: str, provenance: Mapping[str, Any]) -> str:
    """Method, photons, noise: the provenance of a picture in a line."""
    summary, photons = provenance.get("summary", {}), provenance.get("photon_map", {})
    told = [f"{method}.png, by the {method} estimate"]
    if stored := photons.get("stop", {}).get("stored"):
        told.append(f"{stored:.3g} photons")
    elif "rounds" in photons:
        told.append(f"{photons['rounds']} rounds of photons")
    if "seed" in photons:
        told.append(f"seed {photons['seed']}")
    if noise := summary.get("stderr_relative_mean"):
        told.append(f"noise of a pixel {100 * noise:.2g} % of its luminance on average")
    if clipped := summary.get("clipped_fraction"):
        told.append(f"{100 * clipped:.2g} % of the pixels clipped (the EXR holds them as they are)")
    return "; ".join(told) + "."


def _seconds(folder: Path) -> Iterator[str]:
    runs = _last_runs(folder / "timing.csv")
    if runs:
        rows = [
            (command, *run["where"], *(f"{run[stage]:.2f}" if stage in run else "" for stage in STAGES))
            for command, run in runs.items()
        ]
        yield "<h2>Seconds</h2>"
        yield table(
            ("command", "finished (UTC)", "workers", "processor", *STAGES), rows,
            "The last run of each command; all runs: timing.csv.", 4,
        )  # fmt: skip


def _last_runs(timing: Path) -> dict[str, dict[str, Any]]:
    """Seconds by stage of the last run of each command, and where it ran; of a table that somebody has edited, nothing."""
    runs: dict[str, dict[str, Any]] = {}
    if not timing.is_file():
        return runs
    try:
        with open(timing, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                where = (row["finished"].partition("+")[0], row["workers"], row["cpu"])
                if runs.get(row["command"], {}).get("where") != where:
                    runs[row["command"]] = {"where": where}
                runs[row["command"]][row["stage"]] = float(row["seconds"])
    except (KeyError, TypeError, ValueError, csv.Error):
        return {}
    return runs


def _files(folder: Path) -> Iterator[str]:
    told = {name: what for name, what in WHAT.items() if "<" not in name}
    for method in METHODS:
        told |= {f"{method}.{kind}": WHAT[f"<method>.{kind}"] for kind in ("exr", "png")}
    rows = [(name, what) for name, what in told.items() if (folder / name).is_file()]
    yield "<h2>Files</h2>"
    yield table(("file", "what"), rows, "skinrender info FILE tells what one holds and where it came from.", 2)


def _origin(scene: Any, command: str) -> Iterable[str]:
    described = json.dumps(scene.model_dump(mode="json", exclude_none=True), indent=1, ensure_ascii=False)
    return [
        "<h2>How it was made</h2>",
        f"<p><code>{text(command)}</code></p>",
        f'<p class="soft">The scene with all its defaults; what it names lies relative to {text(scene.source_dir)}.</p>',
        f"<pre>{text(described)}</pre>",
    ]
