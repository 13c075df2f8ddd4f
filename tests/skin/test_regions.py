"""Regions between refracting borders, and their indices."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.skin.regions import LIGHT_DEPTH_MM, regions_of
from tests.volumes import Layer, slab_volume


def test_layers_of_one_index_share_exactly_it():
    rng = np.random.default_rng(1)
    for n in rng.uniform(1.0, 2.0, 200):
        layers = tuple(Layer(thickness, 1.0, 1.0, 0.0, n) for thickness in rng.uniform(0.01, 1.0, 3))
        assert regions_of(slab_volume(layers, outside=n)).surface_refracts is False


def test_unequal_layers_share_the_mean_by_the_light_that_reaches_them():
    layers = (Layer(0.1, 1.0, 1.0, 0.0, 1.5), Layer(0.4, 1.0, 1.0, 0.0, 1.4))
    passed = np.exp(-np.array([0.0, 0.1, 0.5]) / LIGHT_DEPTH_MM)
    share = (passed[0] - passed[1]) / (passed[0] - passed[2])
    volume = slab_volume(layers, fresnel=False)
    assert regions_of(volume).index[1] == pytest.approx(1.4 + 0.1 * share)
