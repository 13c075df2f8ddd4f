"""Towards a side by which light leaves the picture falls as steeply as the light does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.maps import light_up, see, slab_data, slab_layer

LARGEST_Z = 4.0
PIXELS, SEEDS = 40, 8
STRIPS = PIXELS // 2


def profile(sides: str, method: str, seed: int) -> np.ndarray:
    """Luminance by distance to the nearest side, (STRIPS,), of a block of 1 mm under a uniform sky."""
    data = slab_data([slab_layer(1.0, 0.05, 20.0, 0.8, 1.4)], {"kind": "sky"}, 1.0, PIXELS)
    y = see(light_up({**data, "sides": sides}, 6000, seed=seed), method)[0].y().astype(float)
    near = np.minimum(np.arange(PIXELS), np.arange(PIXELS)[::-1])
    strip = np.minimum.outer(near, near)
    return np.bincount(strip.ravel(), y.ravel(), STRIPS) / np.bincount(strip.ravel(), minlength=STRIPS)


@pytest.mark.parametrize("sides", ["open", "dielectric"])
def test_the_profile_across_a_side_is_that_of_the_reference(sides):
    """Welch's t of each strip, brought to a normal's quantiles: the middle strip is four pixels, the outermost 156."""
    beam, reference = (
        np.array([profile(sides, method, first + seed) for seed in range(SEEDS)])
        for method, first in (("beam", 1), ("reference", 1 + SEEDS))
    )
    t, p = stats.ttest_ind(beam, reference, equal_var=False)
    z = np.sign(t) * stats.norm.isf(p / 2)
    assert np.all(np.abs(z) < LARGEST_Z), z
    error = np.hypot(stats.sem(beam), stats.sem(reference))
    assert error[0] < 0.03 * reference[:, 0].mean(), "a kernel alone is 66 or 5 % off there"
    assert reference[:, 0].mean() < 0.9 * reference[:, -1].mean(), "there is something to flatten"
