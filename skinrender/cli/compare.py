"""skinrender compare: how far one picture is from another."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console, Row
from skinrender.cli.options import reporting
from skinrender.errors import InputError

if TYPE_CHECKING:
    import numpy as np

_LABELS = {
    "rmse": "root mean square error of luminance",
    "relmse": "relative mean square error",
    "bias": "relative difference of the means",
    "ssim": "structural similarity",
    "delta_e_mean": "color difference CIEDE2000, mean",
    "delta_e_p95": "color difference CIEDE2000, 95th percentile",
}


@click.command()
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@click.option(
    "--mask", "masks", multiple=True, metavar="PNG", type=click.Path(path_type=Path),
    help="Also compare within a region: the white pixels of an image of the pictures' size; may be repeated.",
)  # fmt: skip
@reporting
def compare(a: Path, b: Path, masks: tuple[Path, ...], console: Console) -> None:
    """Compare picture A with the reference B, two EXR files.

    \b
    Example:
      skinrender compare out/fig10_forearm/point.exr out/fig10_forearm/beam.exr --mask lesion.png
    """
    from skinrender.analysis.compare import compare as compare_pictures
    from skinrender.film.exr import read_exr

    summary = compare_pictures(read_exr(a), read_exr(b), _regions(masks) or None)
    rows = _rows(summary)
    for name, region in summary.get("regions", {}).items():
        rows += [("", ""), (f"within {name}", ""), *_rows(region)]
    console.result(summary, rows)


def _regions(masks: tuple[Path, ...]) -> dict[str, np.ndarray]:
    """Masks (h, w) by the names of their files."""
    from skinrender.skin.gray import read_gray

    regions = {path.stem: read_gray(path, ("PNG",)).T >= 0.5 for path in masks}
    if len(regions) < len(masks):
        raise InputError("two masks have one name", where="--mask", remedy="rename one: regions are named by file")
    return regions


def _rows(errors: Mapping[str, Any]) -> list[Row]:
    values = {key: errors[key] for key in _LABELS}
    return [(_LABELS[key], "undefined" if value is None else f"{value:.6g}") for key, value in values.items()]
