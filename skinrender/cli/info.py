"""skinrender info: what a file is and where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinrender.cli.console import Console, Row, with_error
from skinrender.cli.options import reporting
from skinrender.files import bytes_text


@click.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@reporting
def info(file: Path, console: Console) -> None:
    """Say what FILE holds and where it came from.

    A volume, a photon map or a round of one, an EXR picture, a table (.csv), an exported .nrrd or .tif. -v shows the whole
    provenance, without it what it takes to tell two files apart.

    \b
    Example:
      skinrender info out/fig12_epidermal/photons.npz
    """
    from skinrender.cli.describe import describe

    summary = {"file": str(file), **describe(file), "bytes": file.stat().st_size}
    shown = dict(summary)
    if "provenance" in summary and not console.verbose:
        shown["provenance"] = _identity(summary["provenance"])
    console.result(summary, _rows(shown))


def _identity(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Stage, seed, hashes: what a provenance holds beside nested parts, hashes shortened."""
    plain = {key: value for key, value in provenance.items() if isinstance(value, str | int | float)}
    return {key: value[:12] if isinstance(value, str) else value for key, value in plain.items()}


def _rows(summary: Mapping[str, Any]) -> list[Row]:
    return [(key, _text(key, value)) for key, value in summary.items()]


def _text(key: str, value: Any) -> str:
    if isinstance(value, Mapping) and value.keys() == {"count", "min", "max"}:
        return f"{_text(key, value['min'])} to {_text(key, value['max'])}  ({value['count']} values)"
    if isinstance(value, Mapping) and value.keys() == {"value", "stderr"}:
        return with_error(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_text(name, item)}" for name, item in value.items())
    if isinstance(value, list):
        return "[" + ", ".join(_text(key, item) for item in value) + "]"
    if key == "bytes":
        return bytes_text(value)
    return f"{value:.6g}" if isinstance(value, float) else "none" if value is None else str(value)
