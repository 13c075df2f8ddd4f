"""The gallery and the picture of noise: scenes that load, sheets that are drawn, renders that say what they took."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread

from skinrender.analysis import gallery, noise_picture
from skinrender.film.png import write_png
from skinrender.scene.load import load_scene

CONFIGS = Path(__file__).parents[2] / "configs"
CELLS = [cell for row in gallery.SHEET.values() for cell in row]


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: cell.label)
def test_cells_are_scenes(cell):
    scene = load_scene(CONFIGS / f"{cell.scene}.yaml", cell.settings)
    assert cell.has_lesion == bool(scene.lesions) and len(scene.wavelength_nm) == 21
    assert scene.patch.size_mm[0] == (8 if scene.lesions else 6)


def test_sheet_shows_every_picture(tmp_path):
    """Each picture of its own color, in its place."""
    colors = np.random.default_rng(0).integers(60, 200, (2, 3, 3))
    rows = {f"row {r}": [(f"{r} {c}", np.tile(colors[r, c], (9, 9, 1))) for c in range(3)] for r in range(2)}
    gallery.draw_sheet(rows, tmp_path / "sheet.png")
    sheet = imread(tmp_path / "sheet.png")[..., :3]
    for r in range(2):
        places = [np.argwhere((sheet == colors[r, c]).all(axis=2)).mean(axis=0) for c in range(3)]
        assert np.all(np.diff([x for _, x in places]) > sheet.shape[1] / 4) and np.ptp([y for y, _ in places]) < 2


def test_picture_of_the_gallery_and_noise_of_the_paper(tmp_path):
    """Both by the shipped command; with fewer photons the paper gathers as many fewer."""
    cell = gallery.Cell("smoke_beam", "smoke", ("camera.pixels=[8,8]", "bands_nm.step=200"))
    assert gallery.picture(cell, CONFIGS, tmp_path / "cell", 2e4).shape == (8, 8, 3)
    summary = noise_picture.as_paper(CONFIGS / "smoke_point.yaml", tmp_path / "paper", "point", 1e5)
    assert not (tmp_path / "paper" / "photons.npz").exists() and summary["photons_stored"] >= 1e5
    assert 1 < summary["photons_gathered_mean"] < 100 and 0 < summary["stderr_relative_mean"] < 2
    text = noise_picture.caption("paper", summary)
    write_png(tmp_path / "a.png", np.full((30, 30, 3), 0.5))
    noise_picture.draw([(text, tmp_path / "a.png")] * 2, tmp_path / "noise.png")
    assert text.startswith("paper\n") and text.endswith("%") and imread(tmp_path / "noise.png").std() > 0
