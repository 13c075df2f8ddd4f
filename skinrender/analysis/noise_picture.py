"""Figure 10 at the paper's settings and at ours in the same time: ``python -m skinrender.analysis.noise_picture``.

The paper's: 324 million photons stored, none left out, 32 400 gathered by each beam or sample point. With fewer photons
as many fewer are gathered: its kernel.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skinrender.analysis.plots import INK, new_figure, save
from skinrender.analysis.rendered import render
from skinrender.analysis.table1 import PAPER_PHOTONS, paper_options
from skinrender.analysis.tool import options, tool

METHODS = ("point", "beam")
DETAIL = 100
"""Pixels a side of the part that is shown."""


def as_paper(scene: Path, folder: Path, method: str, photons: float) -> dict[str, Any]:
    """Summary of a render at the paper's settings."""
    return render(scene, folder, paper_options(method, photons))


def caption(name: str, summary: dict[str, Any]) -> str:
    """What a picture took and how noisy it is."""
    seconds, noise = summary["seconds"]["total"], 100 * summary["stderr_relative_mean"]
    return f"{name}\n{seconds:.0f} s, noise of a pixel {noise:.2g} %"


def draw(pictures: Sequence[tuple[str, Path]], path: Path) -> None:
    """The middle of each picture, side by side."""
    from skimage.io import imread

    figure = new_figure(3.1 * len(pictures), 3.6, dpi=100)
    for axes, (title, file) in zip(figure.subplots(1, len(pictures)), pictures):
        picture = imread(file)
        top, left = ((size - min(size, DETAIL)) // 2 for size in picture.shape[:2])
        axes.imshow(picture[top : top + DETAIL, left : left + DETAIL], interpolation="nearest")
        axes.set_title(title, fontsize=9, color=INK)
        axes.axis("off")
    save(figure, path)


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Render figure 10 by point and beam as the paper does, then at the defaults for as long as each took."""
    parser = options(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/noise"), help="folder to write to")
    parser.add_argument("--scene", type=Path, default=Path("configs/fig10_forearm.yaml"), help="scene to render")
    parser.add_argument("--photons", type=float, default=PAPER_PHOTONS, help="photons stored at the paper's settings")
    wanted = parser.parse_args(arguments)
    pictures = []
    for method in METHODS:
        paper = as_paper(wanted.scene, wanted.output / method, method, wanted.photons)
        pictures.append((caption(f"as the paper, {method}", paper), wanted.output / method / f"{method}.png"))
        ours_folder = wanted.output / f"defaults_{method}"
        ours = render(wanted.scene, ours_folder, ["--method", "beam", "--time", f"{paper['seconds']['total']:.1f}"])
        pictures.append((caption("defaults, as long", ours), ours_folder / "beam.png"))
    draw(pictures, wanted.output / "noise.png")
    for title, _ in pictures:
        print(title.replace("\n", ": "))


if __name__ == "__main__":
    sys.exit(main())
