import numpy as np
import pytest

from skinrender.errors import RunError
from skinrender.film.color import encode_srgb
from skinrender.film.png import write_png


def test_pixels_are_srgb_and_clipping_is_returned(tmp_path):
    from skimage.io import imread

    rgb = np.random.default_rng(1).random((6, 5, 3))
    rgb[0, 0] = 2.0
    assert write_png(tmp_path / "a.png", rgb) == pytest.approx(1 / 30)
    again = imread(tmp_path / "a.png")
    assert again.dtype == np.uint8
    assert np.array_equal(again, encode_srgb(rgb)[0])


def test_unwritable_place(tmp_path):
    with pytest.raises(RunError, match="absent"):
        write_png(tmp_path / "absent" / "a.png", np.zeros((3, 3, 3)))
