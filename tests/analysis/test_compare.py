import numpy as np
import pytest

from skinrender.analysis.compare import compare, relative_mse
from skinrender.errors import InputError
from skinrender.film import color
from skinrender.film.spectral_image import RgbImage, SpectralImage


def grey(y):
    return RgbImage(np.repeat(np.asarray(y, dtype=float)[..., np.newaxis], 3, axis=-1))


@pytest.fixture
def reference():
    return np.random.default_rng(1).uniform(0.2, 0.8, (20, 30))


def test_a_picture_equals_itself(reference):
    errors = compare(grey(reference), grey(reference))
    assert errors == {"rmse": 0, "relmse": 0, "bias": 0, "ssim": pytest.approx(1), "delta_e_mean": 0, "delta_e_p95": 0}


def test_known_offset_and_gain(reference):
    offset = compare(grey(reference + 0.1), grey(reference))
    assert offset["rmse"] == pytest.approx(0.1)
    assert offset["relmse"] == pytest.approx(np.mean((0.1 / reference) ** 2))
    assert offset["bias"] == pytest.approx(0.1 / reference.mean())
    gain = compare(grey(1.05 * reference), grey(reference))
    assert gain["bias"] == pytest.approx(0.05)
    assert gain["relmse"] == pytest.approx(0.0025)


def test_ssim_is_that_of_scikit_image(reference):
    from skimage.metrics import structural_similarity

    noisy = reference + np.random.default_rng(2).normal(0, 0.1, reference.shape)
    expected = structural_similarity(noisy, reference, data_range=np.ptp(reference))
    assert compare(grey(noisy), grey(reference))["ssim"] == pytest.approx(expected, rel=1e-9)


def test_color_difference_is_ciede2000(reference):
    a = grey(np.full((8, 8), 0.5))
    tinted = a.linear.copy()
    tinted[:, :4, 0] += 0.1
    errors = compare(RgbImage(tinted), a)
    one = float(color.delta_e(color.lab_of_rgb(tinted[0, 0]), color.lab_of_rgb(a.linear[0, 0])))
    assert errors["delta_e_mean"] == pytest.approx(one / 2)
    assert errors["delta_e_p95"] == pytest.approx(one)


def test_regions_see_their_own_pixels_only(reference):
    changed = reference.copy()
    changed[:10] *= 2
    top = np.zeros(reference.shape, bool)
    top[:10] = True
    errors = compare(grey(changed), grey(reference), {"lesion": top, "skin": ~top})
    assert set(errors["regions"]) == {"lesion", "skin"}
    assert errors["regions"]["lesion"]["bias"] == pytest.approx(1)
    assert errors["regions"]["skin"]["rmse"] == 0
    assert set(errors["regions"]["skin"]) == set(errors) - {"regions"}


def test_dark_reference_pixels_are_left_out_of_relmse():
    assert relative_mse(np.array([1.0, 3.0]), np.array([0.0, 2.0])) == pytest.approx(0.25)
    errors = compare(grey(np.zeros((9, 9))), grey(np.zeros((9, 9))))
    assert errors["relmse"] is None and errors["bias"] is None and errors["rmse"] == 0


def test_extreme_light_does_not_overflow(reference):
    for scale in (1e-30, 1e30):
        errors = compare(grey(1.1 * scale * reference), grey(scale * reference))
        assert errors["rmse"] == pytest.approx(0.1 * scale * np.sqrt(np.mean(reference**2)))
        assert errors["relmse"] == pytest.approx(0.01)


def test_tiny_pictures_have_no_ssim():
    assert compare(grey(np.ones((1, 1))), grey(np.ones((1, 1))))["ssim"] is None
    assert compare(grey(np.ones((4, 3))), grey(np.ones((4, 3))))["ssim"] == pytest.approx(1)


def spectral(factor, wavelength_nm):
    irradiance = np.full((8, 8, wavelength_nm.size), 0.1, np.float32)
    zero = np.zeros((8, 8), np.float32)
    exposure = color.exposure_for(irradiance[0, 0], wavelength_nm)
    radiance = (factor * irradiance / np.pi).astype(np.float32)
    return SpectralImage(radiance, wavelength_nm, zero, zero, zero, zero, irradiance, exposure)


def test_one_band_is_compared_in_its_unit():
    band = np.array([450.0])
    errors = compare(spectral(0.6, band), spectral(0.5, band))
    assert errors["rmse"] == pytest.approx(0.1 * 0.1 / np.pi * 1e6, rel=1e-5)
    assert errors["bias"] == pytest.approx(0.2, rel=1e-5)
    assert errors["delta_e_mean"] > 0


def test_many_bands_are_compared_by_luminance_and_radiance_factor():
    bands = np.arange(380.0, 781.0, 5.0)
    errors = compare(spectral(0.6, bands), spectral(0.5, bands))
    assert errors["rmse"] == pytest.approx(0.1, rel=1e-5)
    lab = [[116 * np.cbrt(y) - 16, 0, 0] for y in (0.6, 0.5)]
    assert errors["delta_e_mean"] == pytest.approx(float(color.delta_e(*lab)), abs=1e-3)


def test_mistakes_are_explained(reference):
    with pytest.raises(InputError, match="30 x 20 and 20 x 30"):
        compare(grey(reference), grey(reference.T))
    broken = reference.copy()
    broken[3, 3] = np.nan
    with pytest.raises(InputError, match="1 pixels of picture A"):
        compare(grey(broken), grey(reference))
    with pytest.raises(InputError, match="mask 'lesion'"):
        compare(grey(reference), grey(reference), {"lesion": np.ones((2, 2))})
    with pytest.raises(InputError, match="selects no pixel"):
        compare(grey(reference), grey(reference), {"lesion": np.zeros(reference.shape)})
