from __future__ import annotations

import numpy as np
import pytest

from skinrender.film.skin_color import erythema_index, ita_class, melanin_index

NM = np.arange(400.0, 701.0, 10.0)


@pytest.mark.parametrize(
    "angle, name",
    [(55.1, "very light"), (55.0, "light"), (41.1, "light"), (41.0, "intermediate"), (28.1, "intermediate"),
     (28.0, "tan"), (10.1, "tan"), (10.0, "brown"), (-29.9, "brown"), (-30.0, "dark"), (-90.0, "dark")],
)  # fmt: skip
def test_classes_meet_at_their_borders(angle, name):
    assert ita_class(angle) == name


def test_a_gray_has_no_erythema_and_the_melanin_index_of_its_density():
    gray = np.full(NM.size, 0.01)
    assert melanin_index(gray, NM) == pytest.approx(200.0)
    assert erythema_index(gray, NM) == pytest.approx(0.0, abs=1e-12)


def test_indices_interpolate_between_bands():
    line = NM / 1000.0
    assert melanin_index(line, NM) == pytest.approx(-100.0 * np.log10(0.655))
    assert erythema_index(line, NM) == pytest.approx(100.0 * np.log10(655.0 / 568.0))
    assert np.allclose(melanin_index(np.stack([line, 2 * line]), NM)[1], -100.0 * np.log10(1.31))


@pytest.mark.parametrize("nm", [np.array([550.0]), np.arange(400.0, 651.0, 10.0), np.array([700.0, 710.0])])
def test_without_their_bands_indices_are_no_numbers(nm):
    assert np.isnan(melanin_index(np.full(nm.size, 0.5), nm))


def test_one_band_at_the_very_wavelength_is_enough():
    assert melanin_index(np.array([0.1]), np.array([655.0])) == pytest.approx(100.0)
