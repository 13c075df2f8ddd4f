"""Lesion rules, column by column, against values worked out by hand (paper sections 5 and 6)."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.skin.anatomy import skin_layers
from skinrender.skin.macule import DermalMacule, darken_dermis, darken_epidermis, merge_below, round_half_up
from skinrender.skin.stack import voxel_stack

# Four granular-spinous voxel layers of own content 0.1 over two basal ones of 0.2; horny layer above, dermis below.
EPIDERMIS = ["stratum_corneum"] + 4 * ["granular_spinous"] + 2 * ["basal"] + ["papillary"]
OWN = np.array([0.0, 0.1, 0.1, 0.1, 0.1, 0.2, 0.2, 0.0])
# Two papillary, one subpapillary, one upper plexus, four reticular, one lower plexus, one subcutis.
DEPTHS = ["basal", "papillary", "papillary", "subpapillary", "upper_plexus"]
DEPTHS += 4 * ["reticular"] + ["lower_plexus", "subcutis"]


def _epidermal(p):
    return darken_epidermis(OWN[None], EPIDERMIS, np.array([p]))[0]


def _dermal(p, center, half, own=0.0):
    melanin = np.full((len(p), len(DEPTHS)), own)
    return darken_dermis(melanin, DEPTHS, np.array(p), center, half)


def test_halves_round_up():
    assert round_half_up(np.array([0.0, 0.49, 0.5, 1.5, 2.5, 9 * 0.5, 100 * 0.285])).tolist() == [0, 0, 1, 2, 3, 5, 29]


def test_epidermal_0_percent_is_untouched():
    assert np.array_equal(_epidermal(0.0), OWN)


def test_epidermal_50_percent():
    # M_b = 0.7, m = round(4 * 0.7) = 3; upwards 0.7 - 0.6 j / 4 = 0.55, 0.40, 0.25; the fourth keeps 0.1
    assert np.allclose(_epidermal(0.5), [0, 0.1, 0.25, 0.40, 0.55, 0.7, 0.7, 0], atol=1e-12)


def test_epidermal_100_percent_is_capped():
    # M_b = min(1, 1.2) = 1, m = 4; upwards 1 - 0.9 j / 5
    assert np.allclose(_epidermal(1.0), [0, 0.28, 0.46, 0.64, 0.82, 1, 1, 0], atol=1e-12)


def test_epidermal_never_lightens():
    own = OWN.copy()
    own[1:5] = 0.9
    assert np.array_equal(darken_epidermis(own[None], EPIDERMIS, np.array([0.1]))[0][1:5], own[1:5])


def test_dermal_80_percent():
    # a = 3 is the second reticular voxel layer from the top (index 6); n_i = round(2 * p / 0.8) = 2, 1, 1, 0, none
    melanin, lowest = _dermal([0.8, 0.4, 0.2, 0.1, 0.0], center=3, half=2)
    expected = np.zeros((5, len(DEPTHS)))
    expected[0, 4:9] = expected[1, 5:8] = expected[2, 5:8] = expected[3, 6:7] = 0.8
    assert np.array_equal(melanin, expected) and lowest == 8


def test_dermal_stays_within_the_dermis_and_below_1():
    melanin, lowest = _dermal([0.8], center=2, half=100, own=0.5)
    assert melanin[0].tolist() == [0.5] + 9 * [1.0] + [0.5] and lowest == 9


def test_dermal_white_pattern_changes_nothing():
    melanin, lowest = _dermal([0.0], center=1, half=3)
    assert not melanin.any() and lowest == -1


def test_dermal_center_0_is_the_layer_below_the_reticular():
    melanin, _ = _dermal([0.5], center=0, half=0)
    assert np.flatnonzero(melanin[0]).tolist() == [9]


@pytest.mark.parametrize("center", [-1, 9])
def test_dermal_center_outside_the_dermis(center):
    with pytest.raises(InputError, match="Use 1 to 8"):
        _dermal([0.5], center=center, half=1)


def test_layers_below_the_lowest_changed_one_merge():
    layer, height = np.array([0, 0, 1, 1, 1, 1, 2, 2, 3, 3]), np.arange(1.0, 11)
    first, heights = merge_below(layer, height, lowest=2)
    assert first.tolist() == [0, 1, 2, 3, 6, 8] and heights.tolist() == [1, 2, 3, 4 + 5 + 6, 15, 19]
    assert merge_below(layer, height, lowest=9)[0].tolist() == list(range(10))


def test_forearm_stack_with_dermal_macule():
    """a = 5, n = 2: the 3rd to 7th reticular voxel layer from below change, the 2 below them become one."""
    layers = skin_layers("forearm", {})
    p = np.zeros((3, 2))
    p[1, 0] = 0.45
    stack = voxel_stack(layers, (3, 2), dermal=[DermalMacule(p, 5, 2)])
    reticular, lower, subcutis = (np.flatnonzero(stack.layer == i) for i in (6, 7, 8))
    assert (reticular.size, lower.size, subcutis.size) == (19, 1, 1)
    assert np.isclose(stack.height_mm[reticular[-1]], 0.1) and np.isclose(stack.depth_mm[-1], 4.435)
    darkened = stack.melanin[stack.column_class[1, 0]]
    assert np.flatnonzero(np.isclose(darkened, 0.45)).tolist() == reticular[13:18].tolist()
    assert np.array_equal(stack.column_class == stack.column_class[1, 0], p > 0)


def test_overlapping_epidermal_macules_add_up():
    layers = skin_layers("forearm", {})
    one, other = np.full((1, 1), 0.125), np.full((1, 1), 0.25)
    both = voxel_stack(layers, (1, 1), epidermal=[one, other])
    assert np.array_equal(both.melanin, voxel_stack(layers, (1, 1), epidermal=[one + other]).melanin)


def test_missing_layer_is_named():
    with pytest.raises(InputError, match="basal"):
        darken_epidermis(np.zeros((1, 1)), ["layer_1"], np.array([0.5]))
