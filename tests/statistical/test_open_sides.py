"""Towards a side by which light leaves the picture falls as steeply as the light does."""

from __future__ import annotations

import numpy as np
import pytest

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
    mean, variance = {}, {}
    for k, method in enumerate(("beam", "reference")):
        profiles = np.array([profile(sides, method, 1 + seed + SEEDS * k) for seed in range(SEEDS)])
        mean[method] = profiles.mean(axis=0)
        variance[method] = np.mean((profiles.std(axis=0, ddof=1) / mean[method]) ** 2) / SEEDS
    error = np.sqrt(variance["beam"] + variance["reference"])
    assert error < 0.02
    ratio = mean["beam"] / mean["reference"]
    assert np.all(np.abs(ratio - 1) < LARGEST_Z * error), ratio
    assert mean["reference"][0] < 0.9 * mean["reference"][-1], "there is something to flatten"
