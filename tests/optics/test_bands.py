import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics.bands import band_list, band_range, band_width_nm


def test_default_bands_are_the_81_of_the_paper():
    assert np.array_equal(band_range(), np.arange(380, 781, 5))


def test_fractional_steps_reach_the_end():
    assert np.allclose(band_range(400, 401, 0.1), np.linspace(400, 401, 11))


@pytest.mark.parametrize(
    ("start", "stop", "step"), [(380, 780, 7), (380, 780, 0), (380, 780, -5), (780, 380, 5), (380, 780, 1), (0, 10, 5)]
)
def test_impossible_ranges_are_refused(start, stop, step):
    with pytest.raises(InputError):
        band_range(start, stop, step)


@pytest.mark.parametrize("wavelengths", [[], [500, 400], [500, 500], [-1, 3], [np.nan], [[400, 500]], range(1, 300)])
def test_impossible_lists_are_refused(wavelengths):
    with pytest.raises(InputError):
        band_list(wavelengths)


def test_widths_are_equal_on_a_regular_grid_and_halved_distances_elsewhere():
    assert np.allclose(band_width_nm(band_range()), 5)
    assert np.allclose(band_width_nm(band_list([400, 410, 450])), [10, 25, 40])
    assert np.allclose(band_width_nm(band_list([450])), 1)
