"""One scene by beam, point and reference beside each other, with their differences: `make methods`.

``python -m skinrender.analysis.method_pictures FOLDER PNG`` reads ``beam.exr``, ``point.exr`` and ``reference.exr`` of
a ``render`` folder. All three see the same photons, so that most of their noise is common.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from skinrender.analysis.compare import Picture, compare
from skinrender.analysis.plots import INK, new_figure, save
from skinrender.analysis.tool import options, tool
from skinrender.film.color import encode_srgb
from skinrender.film.exr import read_exr

METHODS = ("beam", "point", "reference")
LIMIT = 20.0
"""Percent at the ends of the color bar."""
SMOOTH = 1.5
"""Standard deviation in pixels of the blur of the differences: what is seen is a pattern, not the reference's noise."""


def read_pictures(folder: Path) -> dict[str, Picture]:
    """Pictures of a folder by method."""
    return {method: read_exr(folder / f"{method}.exr") for method in METHODS}


def smooth_difference(picture: Picture, reference: Picture) -> np.ndarray:
    """Difference of the blurred luminances over the reference's, (h, w)."""
    a, b = (gaussian_filter(image.y().astype(float), SMOOTH) for image in (picture, reference))
    return np.divide(a - b, b, out=np.zeros_like(a), where=b > 0.0)


def draw(pictures: Mapping[str, Picture]) -> Any:
    """The pictures, and below them what differs from the reference."""
    reference = pictures["reference"]
    figure = new_figure(3.0 * len(METHODS) + 0.8, 6.6)
    figure.set_layout_engine("compressed")
    top, bottom = figure.subplots(2, len(METHODS))
    for method, above, below in zip(METHODS, top, bottom):
        picture = pictures[method]
        above.imshow(encode_srgb(picture.display_rgb())[0], interpolation="nearest")
        above.set_title(method, color=INK, fontsize=10)
        if method == "reference":
            noise = picture.stderr_Y / np.maximum(picture.y(), 1e-30)
            title = "its standard error, not blurred"
            drawn = below.imshow(100 * noise, cmap="RdBu_r", vmin=-LIMIT, vmax=LIMIT, interpolation="nearest")
        else:
            told = compare(picture, reference)
            title = f"mean {100 * told['bias']:+.2f} %, dE00 of a pixel {told['delta_e_mean']:.1f}"
            difference = 100 * smooth_difference(picture, reference)
            drawn = below.imshow(difference, cmap="RdBu_r", vmin=-LIMIT, vmax=LIMIT, interpolation="nearest")
        below.set_title(title, color=INK, fontsize=9)
        for axes in (above, below):
            axes.set(xticks=[], yticks=[])
    bar = figure.colorbar(drawn, ax=list(bottom), aspect=22, extend="both")
    bar.set_label("(picture - reference) / reference / %, blurred", color=INK, fontsize=8)
    return figure


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Draw a folder's pictures."""
    parser = options(__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of a render, with a picture by each method")
    parser.add_argument("png", type=Path, metavar="PNG", help="file to write")
    wanted = parser.parse_args(arguments)
    save(draw(read_pictures(wanted.folder)), wanted.png)


if __name__ == "__main__":
    sys.exit(main())
