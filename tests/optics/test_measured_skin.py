from __future__ import annotations

import numpy as np
import pytest

from skinrender.film.color import ita_deg, lab_of_factor
from skinrender.optics.measured_skin import TONES, measured_at, measured_tone

NM = np.arange(400.0, 701.0, 5.0)


@pytest.mark.parametrize("site, lab", [("forearm", (66.3, 7.0, 16.5)), ("cheek", (64.3, 12.2, 15.2))])
def test_colors_are_the_published_means(site, lab):
    mean, sd = measured_at(site).on_bands(NM)
    assert np.abs(lab_of_factor(mean, NM) - lab).max() < 0.3
    assert 30.0 < ita_deg(lab_of_factor(mean, NM)) < 55.0
    assert np.all((sd > 0.01) & (sd < 0.1))


def test_nothing_is_known_beyond_what_was_measured():
    mean, sd = measured_at("forearm").on_bands(np.array([380.0, 400.0, 700.0, 705.0]))
    assert np.isnan(mean).tolist() == np.isnan(sd).tolist() == [True, False, False, True]


@pytest.mark.parametrize("tone, lowest, highest", list(zip(TONES, (55, 41, 28, 10, -30), (90, 55, 41, 28, 10))))
def test_means_of_tones_lie_in_their_classes(tone, lowest, highest):
    m = measured_tone(tone)
    assert lowest < ita_deg(lab_of_factor(m.mean, m.wavelength_nm)) < highest
    assert np.all((m.least < m.mean) & (m.mean < m.largest))
    assert np.all((m.sd > 0) & (m.sd < m.largest - m.least))


def test_a_tone_of_the_forearm_has_its_own_table():
    assert measured_at("forearm", "tan").name == "tan forearms"
    assert measured_at("cheek", "tan") is None


def test_other_sites_have_no_table():
    assert measured_at("palm") is None
