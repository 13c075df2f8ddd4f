"""The table of lesions by depth and amount, and its plots: ``python -m skinrender.analysis.lesion_table``."""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from skinrender.analysis.lesion_plot import draw_light_depth, draw_table
from skinrender.analysis.lesion_sweep import Row, forearm, rows
from skinrender.analysis.light_depth import light_depth, write_light_depth
from skinrender.analysis.tool import options, tool
from skinrender.atomic import whole_file


def markdown(table: Sequence[Row]) -> str:
    """The table in Markdown."""
    lines = ["| lesion | where | pigment / um | mean depth / mm | dL\\* | da\\* | db\\* |", "|---|---|---:|---:|---:|---:|---:|"]
    for row in table:
        lab = " | ".join(f"{value:+.1f} ± {error:.1f}" for value, error in zip(row.lab, row.lab_stderr))
        lines.append(f"| {row.kind} | {row.where} | {row.amount_um:.3g} | {row.depth_mm:.3f} | {lab} |")
    return "\n".join(lines) + "\n"


def write_csv(table: Sequence[Row], path: Path) -> None:
    """A line for each lesion."""
    names = [f"d{axis}{suffix}" for suffix in ("", "_stderr") for axis in "Lab"]
    with whole_file(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["lesion", "where", "pigment_um", "mean_depth_mm", *names])
        for row in table:
            numbers = (row.amount_um, row.depth_mm, *row.lab, *row.lab_stderr)
            writer.writerow([row.kind, row.where, *(f"{value:.5g}" for value in numbers)])


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Walk the lesions, print the table and write it with its plots."""
    parser = options(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/lesion_table"), help="folder to write to")
    parser.add_argument("--stderr", type=float, default=0.01, help="relative standard error of the reflectances")
    wanted = parser.parse_args(arguments)
    wanted.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="skinrender-") as folder:
        table = list(rows(Path(folder), wanted.stderr))
        depth = light_depth(lambda *lesions: forearm(Path(folder), lesions, step_nm=20.0), wanted.stderr)
    write_csv(table, wanted.output / "lesion_table.csv")
    with whole_file(wanted.output / "lesion_table.md") as partial:
        partial.write_text(markdown(table), encoding="utf-8")
    draw_table(table, wanted.output / "lesion_table.png")
    write_light_depth(depth, wanted.output / "light_depth.csv")
    draw_light_depth(depth, wanted.output / "light_depth.png")
    print(markdown(table), end="")


if __name__ == "__main__":
    sys.exit(main())
