"""A picture that grows: the same as that of a map of its rounds, and done when it should be."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from skinrender.engine.estimate import estimate
from skinrender.engine.progressive import FIRST_ROUNDS, Goal, Part, next_rounds, render_until, rounds_in
from skinrender.engine.recipe import HeldRecipe
from skinrender.errors import InputError
from skinrender.estimate.scatter_image import MOST_POOLED, ScatteredLight, batch_stderr, pooled
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.light import light_from_scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from tests.maps import slab_data, slab_layer

SLAB = slab_data([slab_layer(1.0, 0.5, 20.0, 0.8, 1.4)], {"kind": "collimated"}, 2.0, 8)


@pytest.fixture(autouse=True)
def small_rounds(monkeypatch):
    monkeypatch.setattr("skinrender.engine.progressive.ROUND_STORED", 2000)


def grow(goal: Goal, **changes):
    """Trace summary and the pictures that were shown, with what was told of them."""
    scene = make_scene({**SLAB, **changes})
    volume = build_volume(scene)
    shown = []
    recipe = HeldRecipe(volume, light_from_scene(scene), True)
    traced = render_until(goal, scene, volume, recipe, lambda *one: shown.append(one), progress=False, threads=2)
    return scene, volume, recipe, traced, shown


def noise(seed: int, batches: int) -> ScatteredLight:
    rng = np.random.default_rng(seed)
    rounds = rng.integers(1, 4, batches)
    values = rng.normal(1.0, 1.0 / np.sqrt(rounds))
    y = np.repeat(values, 6).reshape(batches, 2, 3).astype(np.float32)
    mean = np.full((2, 3, 1), values @ rounds / rounds.sum(), np.float32)
    return ScatteredLight(mean, y, values, rounds, 1.0, {"mesh": (0.1, 0.01)})


def test_noise_asked_for_is_reached_and_told():
    _, _, _, traced, shown = grow(Goal(error=0.02))
    errors = [summary.stderr_relative_mean for _, summary in shown]
    assert errors[-1] <= 0.02 < errors[-2]
    assert traced.rounds == shown[-1][0].provenance["photon_map"]["rounds"]
    assert traced.lost == 0


def test_picture_is_that_of_a_map_of_its_rounds():
    scene, volume, recipe, traced, shown = grow(Goal(error=0.02))
    histories = np.array(shown[-1][0].provenance["photon_map"]["histories_per_round"])
    photon_pass = recipe.build(scene.photons.seed)
    whole = map_from_rounds(photon_pass, [photon_pass.walk(k, histories, True) for k in range(traced.rounds)])
    image, summary = estimate(scene, volume, whole, progress=False)
    grown, told = shown[-1]
    assert grown.radiance == pytest.approx(image.radiance, rel=1e-5)
    assert told.mean_radiance == pytest.approx(summary.mean_radiance, rel=1e-6)
    assert told.mean_radiance_stderr == pytest.approx(summary.mean_radiance_stderr, rel=0.5)


def test_time_that_is_over_ends_after_the_first_part():
    *_, traced, shown = grow(Goal(deadline=time.monotonic()))
    assert len(shown) == 1
    assert traced.rounds == FIRST_ROUNDS


def test_dark_picture_is_done_at_once():
    clear = {"layers": [slab_layer(1.0, 0.5, 0.0, 0.0, 1.4)]}
    *_, shown = grow(Goal(error=1e-6), slab=clear)
    assert len(shown) == 1
    assert not shown[0][0].radiance.any()


def test_gather_count_needs_a_number_of_photons():
    with pytest.raises(InputError, match="gather count"):
        grow(Goal(error=0.1), estimate={"gather_count": 100})


def test_rounds_follow_from_the_error():
    parts = [Part(20, 1.0, 1.0)]
    assert next_rounds(Goal(error=0.02), [], None, 100, 0.0) == 20
    assert next_rounds(Goal(error=0.02), parts, 0.02, 100, 0.0) == 0
    assert next_rounds(Goal(error=0.02), parts, 0.04, 100, 0.0) == pytest.approx(3 * 20 + 9, abs=1)
    assert next_rounds(Goal(error=0.02), parts, 0.4, 100, 0.0) == 100
    assert next_rounds(Goal(error=0.02), parts, None, 100, 0.0) == 0
    assert next_rounds(Goal(error=0.02, deadline=5.0), parts, 0.4, 100, 6.0) == 0


def test_rounds_fit_the_time_left():
    """A part of n rounds takes 0.1 n seconds to walk and 2 + 0.05 n for the rest."""
    parts = [Part(20, 2.0, 3.0), Part(40, 4.0, 4.0)]
    for seconds in (3.0, 10.0, 50.0):
        rounds = rounds_in(seconds, parts)
        assert 2.0 + 0.15 * rounds == pytest.approx(seconds, abs=0.151)
    assert rounds_in(2.2, parts) == 0
    assert rounds_in(1.0, parts[:1]) == 0


def test_pooled_parts_weigh_as_their_rounds():
    a, b = noise(1, 20), noise(2, 5)
    both = pooled(a, b)
    rounds = np.concatenate([a.batch_rounds, b.batch_rounds])
    values = np.concatenate([a.batch_radiance, b.batch_radiance])
    assert both.radiance == pytest.approx(np.full((2, 3, 1), values @ rounds / rounds.sum()), rel=1e-6)
    assert both.remaining["mesh"][0] == pytest.approx(0.1)
    assert both.remaining["mesh"][1] < 0.01


def test_batches_stay_few_and_keep_mean_and_error():
    parts = [noise(seed, 20) for seed in range(40)]
    light = parts[0]
    for part in parts[1:]:
        light = pooled(light, part)
    assert len(light.batch_rounds) <= MOST_POOLED
    assert light.batch_rounds.sum() == sum(part.batch_rounds.sum() for part in parts)
    assert light.radiance[0, 0, 0] == pytest.approx(light.batch_radiance @ light.batch_rounds / light.batch_rounds.sum())
    expected = 1.0 / np.sqrt(light.batch_rounds.sum())
    assert batch_stderr(light.batch_radiance, light.batch_rounds) == pytest.approx(expected, rel=0.4)
    assert batch_stderr(light.batch_y, light.batch_rounds) == pytest.approx(np.full((2, 3), expected), rel=0.4)
    assert dataclasses.asdict(light)["gathered"] == pytest.approx(40.0)
