import numpy as np

from skinrender.optics.bands import band_width_nm


def test_widths_are_equal_on_a_regular_grid_and_halved_distances_elsewhere():
    assert np.allclose(band_width_nm(np.arange(380.0, 781.0, 5.0)), 5)
    assert np.allclose(band_width_nm(np.array([400.0, 410.0, 450.0])), [10, 25, 40])
    assert np.allclose(band_width_nm(np.array([450.0])), 1)
