"""The presets beside measured skin: what docs/skin.md says of them, by the photon walk and its standard errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skinrender
from skinrender.analysis.measured_table import LAST_NM, SITES, compared
from skinrender.optics.measured_skin import TONES
from skinrender.scene import load_scene

CONFIGS = Path(__file__).parents[2]
STDERR = 0.004
LARGEST_Z = 4.5
"""Reached by chance once in a thousand times among the 41 bands of five classes."""
LARGEST_DELTA_E = {"site": 2.0, "tone": 3.0}


def walked(site, *overrides):
    """A preset beside its measured table, and the standard errors of its reflectance on the table's bands."""
    scene = load_scene(CONFIGS / SITES[site], ["bands_nm.step=10", "relief.kind=flat", *overrides])
    found = skinrender.spectrum(scene, stderr=STDERR, workers=1)
    beside = compared(found)
    return beside, found.patch.total_stderr[np.isin(found.wavelength_nm, beside.wavelength_nm)]


def surely_below(beside, largest):
    """Whether the color difference and LARGEST_Z of its standard errors stay below a bound."""
    return beside.delta_e + LARGEST_Z * np.linalg.norm(beside.found.patch.color.lab_stderr) < largest


@pytest.mark.slow
@pytest.mark.parametrize("site", SITES)
def test_sites_lie_within_a_standard_deviation_of_the_japanese_means(site):
    beside, stderr = walked(site)
    largest = np.abs(beside.deviation) + LARGEST_Z * stderr / beside.sd
    assert largest[(beside.wavelength_nm >= 400.0) & (beside.wavelength_nm <= LAST_NM)].max() < 1.0
    assert surely_below(beside, LARGEST_DELTA_E["site"])


@pytest.mark.slow
@pytest.mark.parametrize("tone", TONES)
def test_tones_lie_among_the_subjects_of_their_class(tone):
    beside, stderr = walked("forearm", f"skin.tone={tone}")
    nm, measured = beside.wavelength_nm, beside.found.measured
    least, largest = (np.interp(nm, measured.wavelength_nm, of) for of in (measured.least, measured.largest))
    reflectance = beside.mean + beside.deviation * beside.sd
    inside = np.minimum(reflectance - least, largest - reflectance) / stderr
    assert inside.min() > -LARGEST_Z
    assert inside[(nm >= 400.0) & (nm <= 700.0)].min() > LARGEST_Z
    assert surely_below(beside, LARGEST_DELTA_E["tone"])
