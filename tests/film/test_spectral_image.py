from dataclasses import replace

import numpy as np
import pytest

from skinrender.film import color
from skinrender.film.spectral_image import RgbImage


def diffuser(image, factor):
    return replace(image, radiance=(factor * image.irradiance / np.pi).astype(np.float32))


@pytest.mark.parametrize("lamp", ["D65", "A", "LED-B3"])
def test_a_grey_card_is_the_same_everywhere_in_lab_whatever_the_lamp(make_image, lamp):
    card = diffuser(make_image(lamp=lamp), 0.18)
    assert np.allclose(card.radiance_factor()[..., card.light > 0], 0.18, rtol=1e-5)
    assert np.allclose(card.lab(), [116 * np.cbrt(0.18) - 16, 0, 0], atol=1e-3)


def test_a_grey_card_is_neutral_and_as_bright_as_its_light(make_image):
    card = diffuser(make_image(lamp="A"), 0.5)
    expected = 0.5 * card.irradiance.sum(axis=-1) / 0.1
    assert np.allclose(card.rgb(), expected[..., np.newaxis], rtol=1e-4)
    assert np.allclose(card.y(), expected, rtol=1e-5)


def test_one_band_is_its_radiance_and_exposed_only_for_the_screen(make_image):
    image = diffuser(make_image([450]), 1.0)
    assert np.allclose(image.rgb(), 1e6 * image.radiance, rtol=1e-6)
    assert np.allclose(image.y(), 1e6 * image.radiance[..., 0], rtol=1e-6)
    assert np.allclose(image.display_rgb(), image.irradiance / 0.1, rtol=1e-5)


def test_unlit_pixels_have_no_nan(make_image):
    image = make_image()
    dark = replace(image, irradiance=np.zeros_like(image.irradiance))
    assert np.all(dark.radiance_factor() == 0)
    for pixels in (dark.lab(), dark.rgb(), dark.y()):
        assert np.isfinite(pixels).all()


def test_shapes_must_agree(make_image):
    image = make_image()
    for name, wrong in (
        ("wavelengths", {"wavelength_nm": image.wavelength_nm[1:]}),
        ("stderr_Y", {"stderr_Y": np.zeros((2, 2))}),
        ("irradiance", {"irradiance": image.irradiance[:2]}),
    ):
        with pytest.raises(ValueError, match=name):
            replace(image, **wrong)


def test_rgb_image_luminance_is_that_of_srgb(make_image):
    image = RgbImage(np.eye(3)[np.newaxis])
    assert np.allclose(image.y(), [[0.2126, 0.7152, 0.0722]], atol=1e-4)
    assert np.allclose(image.lab(), color.lab_of_rgb(image.rgb()))
