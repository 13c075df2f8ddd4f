import warnings

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics.illuminants import band_weights, illuminant_names, spectral_power

BANDS = np.arange(380.0, 781.0, 5.0)


@pytest.fixture(scope="module")
def colour():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour


@pytest.mark.parametrize("name", illuminant_names())
def test_spectra_are_the_cies(colour, name):
    shape = colour.SpectralShape(380, 780, 5)
    expected = colour.SDS_ILLUMINANTS[name].copy().align(shape).values
    assert np.allclose(spectral_power(name, BANDS), expected, rtol=1e-5)


@pytest.mark.parametrize("name", illuminant_names())
def test_shares_sum_to_one(name):
    weights = band_weights(name, BANDS)
    assert weights.sum() == pytest.approx(1, abs=1e-14)
    assert np.all(weights >= 0)


def test_equal_energy_is_shared_equally_and_one_band_has_all():
    assert np.allclose(band_weights("E", BANDS), 1 / 81)
    assert band_weights("D65", np.array([555], float)) == pytest.approx([1.0])


def test_wide_bands_have_a_larger_share():
    assert np.allclose(band_weights("E", np.array([400, 410, 450], float)), np.array([10, 25, 40]) / 75)


def test_a_users_lamp(tmp_path):
    lamp = tmp_path / "lamp.csv"
    lamp.write_text("wavelength_nm,value\n380,0\n780,400\n")
    expected = (BANDS - 380) / (BANDS - 380).sum()
    assert np.allclose(band_weights(lamp, BANDS), expected)


def test_unknown_names_are_answered_with_a_guess():
    with pytest.raises(InputError, match="did you mean 'LED-B3'"):
        band_weights("led-b3", BANDS)


def test_bands_without_a_table_or_without_light_are_refused(tmp_path):
    with pytest.raises(InputError, match="850 nm"):
        band_weights("D65", np.array([850], float))
    assert band_weights("A", np.array([850, 900], float)).sum() == pytest.approx(1)
    with pytest.raises(InputError, match="no light"):
        band_weights("LED-B3", np.array([380], float))
    lamp = tmp_path / "negative.csv"
    lamp.write_text("380,1\n780,-1\n")
    with pytest.raises(InputError, match="negative"):
        band_weights(lamp, BANDS)
