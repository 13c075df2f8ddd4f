"""A sheet of skins, by `skinrender render`: sites, tones, ages, lesions, light.

``python -m skinrender.analysis.gallery`` renders and draws it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinrender.analysis.plots import INK, new_figure, save
from skinrender.analysis.rendered import render
from skinrender.analysis.tool import options, tool

CLOSE = ("bands_nm.step=20", "patch.size_mm=[6,6]", "camera.pixels=[180,180]")
"""6 mm across: furrows of 100 um are three columns and pixels wide. 21 bands color skin as 81 do."""
LESION = ("bands_nm.step=20", "patch.size_mm=[8,8]", "camera.pixels=[100,100]")
"""Kernels at a lesion's edge are 1.5 pixels wide: of 0.08 mm, with four times the photons, they still show specks of
color."""
MORE_PHOTONS = 4
SIDE = "light={kind: collimated, zenith_deg: 65, azimuth_deg: 215}"
SKY = "light={kind: sky}"
OLD = "relief.age_years=75"


@dataclass(frozen=True)
class Cell:
    """One picture: a scene of `configs`, what is set in it, and its label."""

    scene: str
    label: str
    changes: tuple[str, ...] = ()

    @property
    def has_lesion(self) -> bool:
        """Whether its scene is one of the lesions."""
        return self.scene not in ("fig10_forearm", "cheek")

    @property
    def settings(self) -> tuple[str, ...]:
        """All that is set in the scene."""
        return (*(LESION if self.has_lesion else CLOSE), *self.changes)


SHEET = {
    "tones, lamp above": tuple(
        Cell("fig10_forearm", f"forearm, {tone.replace('_', ' ')}", (f"skin.tone={tone}",))
        for tone in ("very_light", "light", "intermediate", "tan", "brown")
    )
    + (Cell("cheek", "cheek"),),
    "lesions, lamp above": (
        Cell("freckles", "freckles, cheek"),
        Cell("fig12_epidermal", "lentigo", ("lesions.0.melanin_scale=0.4",)),
        Cell("mole", "mole"),
        Cell("nevus_of_ota", "nevus of Ota, cheek"),
        Cell("blue_nevus", "blue nevus"),
        Cell("tattoo", "tattoo"),
    ),
    "other light, age, oil": (
        Cell("fig10_forearm", "forearm, from the side", (SIDE,)),
        Cell("cheek", "cheek, from the side", (SIDE,)),
        Cell("fig10_forearm", "75 years, from the side", (SIDE, OLD)),
        Cell("mole", "mole, from the side", (SIDE,)),
        Cell("fig10_forearm", "brown and oily, from the side", (SIDE, "skin.tone=brown", "finish.oil=0.3")),
        Cell("tattoo", "tattoo, overcast sky, light skin", (SKY, "skin.tone=light")),
    ),
}


def picture(cell: Cell, configs: Path, folder: Path, photons: float) -> np.ndarray:
    """A cell's picture (h, w, 3) u1; one with a lesion takes four times the photons."""
    from skimage.io import imread

    photons *= MORE_PHOTONS if cell.has_lesion else 1
    changes = [word for setting in cell.settings for word in ("--set", setting)]
    render(configs / f"{cell.scene}.yaml", folder, ["--method", "beam", "--photons", f"{photons:g}", *changes])
    return imread(folder / "beam.png")


def draw_sheet(pictures: dict[str, Sequence[tuple[str, np.ndarray]]], path: Path) -> None:
    """Rows of labelled pictures, each with its heading."""
    columns = max(len(row) for row in pictures.values())
    figure = new_figure(1.85 * columns, 2.25 * len(pictures), dpi=110)
    for part, (heading, row) in zip(np.atleast_1d(figure.subfigures(len(pictures), 1)), pictures.items()):
        part.suptitle(heading, fontsize=10, color=INK, x=0.005, ha="left")
        places = part.subplots(1, columns)
        for axes in places:
            axes.axis("off")
        for axes, (label, shown) in zip(places, row):
            axes.imshow(shown, interpolation="lanczos")
            axes.set_title(label, fontsize=7, color=INK)
    save(figure, path)


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Render the sheet and write ``gallery.png``."""
    parser = options(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/gallery"), help="folder to write to")
    parser.add_argument("--configs", type=Path, default=Path("configs"), help="folder of the shipped scenes")
    parser.add_argument("--photons", type=float, default=1e7, help="photons of a picture without a lesion")
    wanted = parser.parse_args(arguments)
    pictures = {
        heading: [
            (cell.label, picture(cell, wanted.configs, wanted.output / f"{r}_{c}", wanted.photons))
            for c, cell in enumerate(row)
        ]
        for r, (heading, row) in enumerate(SHEET.items())
    }
    draw_sheet(pictures, wanted.output / "gallery.png")


if __name__ == "__main__":
    sys.exit(main())
