"""The spectral stack as tifffile reads it, which knows ImageJ's labels."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

from skinrender.errors import InputError
from skinrender.export.tiff import write_tiff
from skinrender.film.exr import write_exr
from skinrender.film.spectral_image import SpectralImage


@pytest.fixture
def picture(tmp_path):
    radiance = np.random.default_rng(1).random((4, 6, 3), np.float32)
    flat = np.zeros((4, 6), np.float32)
    irradiance = np.full((4, 6, 3), 1.0, np.float32)
    image = SpectralImage(radiance, np.array([450.0, 550.0, 650.0]), flat, flat, flat, flat, irradiance, 1.0)
    path = tmp_path / "beam.exr"
    write_exr(path, image)
    return path, radiance


def test_pages_labels_and_pixel_size(picture, tmp_path):
    path, radiance = picture
    assert write_tiff(path, tmp_path / "beam.tif", (6, 4), (0.1, 0.2)) == 3
    with tifffile.TiffFile(tmp_path / "beam.tif") as file:
        assert file.is_imagej
        assert file.imagej_metadata["Labels"] == ["450 nm", "550 nm", "650 nm"]
        assert file.imagej_metadata["unit"] == "mm"
        across, one = file.pages[0].tags["XResolution"].value
        assert across / one == pytest.approx(10.0)
        stack = file.asarray()
    assert stack.dtype == np.float32
    assert stack == pytest.approx(1e6 * np.moveaxis(radiance, 2, 0), rel=1e-5)


def test_picture_of_another_camera_is_refused(picture, tmp_path):
    """The pixels' size would be wrong."""
    with pytest.raises(InputError, match="6 x 4 pixels, the scene's camera 4 x 6"):
        write_tiff(picture[0], tmp_path / "beam.tif", (4, 6), (0.1, 0.2))
    assert not (tmp_path / "beam.tif").exists()


def test_picture_without_spectrum_is_refused(tmp_path):
    import OpenEXR

    path = tmp_path / "plain.exr"
    pixels = np.ones((2, 2), np.float32)
    with OpenEXR.File({}, {name: pixels for name in "RGB"}) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="no spectrum"):
        write_tiff(path, tmp_path / "plain.tif", (2, 2), (1.0, 1.0))
    assert not (tmp_path / "plain.tif").exists()
