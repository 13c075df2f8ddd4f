"""skinrender merge: shards -> one photon map."""

from __future__ import annotations

from pathlib import Path

import click

from skinrender.cli.console import Console, seconds_row
from skinrender.cli.options import reporting


@click.command()
@click.argument("shards", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Folder of the photon map."
)
@reporting
def merge(shards: tuple[Path, ...], output: Path, console: Console) -> None:
    """Join the folders that `trace --shard` wrote into one photons.npz.

    The map is the same, byte for byte, as that of an undivided run.

    \b
    Example:
      skinrender merge out/part0 out/part1 -o out/fig12_epidermal
    """
    from skinrender.cli.job import make_folder
    from skinrender.cli.stages import trace_rows
    from skinrender.engine.shards import merge as merge_shards

    written = make_folder(output) / "photons.npz"
    summary = merge_shards(shards, output).as_json() | {"files": [str(written)]}
    console.result(
        summary,
        [*trace_rows(summary, console.verbose), seconds_row(summary["seconds"]), ("wrote", str(written))],
    )
