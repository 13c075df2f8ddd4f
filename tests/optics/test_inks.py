"""Ink spectra: the shipped table against what its header says, users' files, mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics.inks import ink_absorption, ink_names

NM = np.arange(380.0, 781.0, 5.0)
BANDS = {
    "red": ((560, 0.075, 8000), (525, 0.11, 11000), (480, 0.20, 8000), (330, 0.35, 12000)),
    "blue": ((720, 0.065, 11000), (645, 0.11, 15000), (590, 0.16, 7000), (340, 0.35, 12000)),
    "green": ((700, 0.08, 6500), (640, 0.10, 10000), (590, 0.09, 2800), (375, 0.32, 9500)),
}


def test_carbon_black_is_that_of_small_spheres_of_soot():
    x = np.log(NM / 1000)
    n = 1.811 + 0.1263 * x + 0.027 * x**2 + 0.0417 * x**3
    k = 0.5821 + 0.1213 * x + 0.2309 * x**2 - 0.01 * x**3
    square = ((n + 1j * k) / 1.38) ** 2
    expected = 6 * np.pi * 1.38 / (NM * 1e-6) * ((square - 1) / (square + 2)).imag
    assert np.allclose(ink_absorption("carbon_black", NM), expected, rtol=1e-4)


@pytest.mark.parametrize("name", BANDS)
def test_colored_inks_are_the_bands_of_the_header(name):
    energy = 1239.84 / NM
    expected = sum(high * np.exp(-((energy - 1239.84 / nm) ** 2) / (2 * ev**2)) for nm, ev, high in BANDS[name])
    assert np.allclose(ink_absorption(name, NM), expected, rtol=1e-4)


@pytest.mark.parametrize(("name", "passed"), [("red", (640, 780)), ("blue", (460, 520)), ("green", (490, 540))])
def test_an_ink_lets_pass_the_light_of_its_color(name, passed):
    mu_a = ink_absorption(name, NM)
    window = (NM >= passed[0]) & (NM <= passed[1])
    assert mu_a[window].max() < 0.1 * mu_a[~window].max()


def test_a_users_ink(tmp_path):
    file = tmp_path / "mine.csv"
    file.write_text("wavelength_nm,mu_a_per_mm\n380,0\n780,4000\n")
    assert np.allclose(ink_absorption(file, NM), 10 * (NM - 380))


def test_unknown_ink():
    assert ink_names() == ("carbon_black", "red", "blue", "green")
    with pytest.raises(InputError, match="did you mean 'blue'"):
        ink_absorption("bleu", NM)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("wavelength_nm,mu_a_per_mm\n380,1\n780,many\n", r"mine\.csv:3:1: expected 'wavelength_nm,value', got '780,many'"),
        ("380,1\n780,-1\n", r"mine\.csv:2:1: .*negative"),
        ("380,1\n370,1\n", r"mine\.csv:2:1: .*ascend"),
        ("400,1\n780,1\n", r"mine\.csv: the band 380 nm lies outside"),
    ],
)
def test_a_wrong_file_is_told_with_place_and_remedy(tmp_path, text, place):
    file = tmp_path / "mine.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=place) as told:
        ink_absorption(file, NM)
    assert len(str(told.value).splitlines()) == 2
