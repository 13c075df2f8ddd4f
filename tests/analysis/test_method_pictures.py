"""The three methods beside each other: from a folder of `render` to a PNG."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from skimage.io import imread

from skinrender.analysis.method_pictures import METHODS, main, smooth_difference
from skinrender.film.exr import write_exr
from tests.maps import light_up, see, slab_data, slab_layer


@pytest.fixture(scope="module")
def image():
    return see(light_up(slab_data([slab_layer(0.5, 0.5, 10.0, 0.5, 1.4)], {"kind": "collimated"}, pixels=12), 50))[0]


def test_difference_is_relative_to_the_reference(image):
    brighter = replace(image, radiance=1.1 * image.radiance)
    assert smooth_difference(brighter, image) == pytest.approx(np.full((12, 12), 0.1), rel=1e-4)


def test_pictures_of_a_folder(image, tmp_path):
    write_exr(tmp_path / "beam.exr", image)
    for method in METHODS[1:]:
        shutil.copy(tmp_path / "beam.exr", tmp_path / f"{method}.exr")
    assert main([str(tmp_path), str(tmp_path / "methods.png")]) == 0
    assert imread(tmp_path / "methods.png").std() > 10


def test_missing_picture_is_told(tmp_path, capsys):
    assert main([str(tmp_path), str(tmp_path / "methods.png")]) == 2
    assert "beam.exr" in capsys.readouterr().err
