"""Fractions sum to one, errors are those of independent rounds, and the JSON has the keys it promises."""

from __future__ import annotations

import json

import numpy as np
import pytest
from fake_pass import POWER, FakePass, FakeRecipe

from skinrender.engine.ledger import Batches, Ledger
from skinrender.engine.run import count_light
from skinrender.engine.stop import StandardError
from skinrender.engine.summary import summarize
from skinrender.errors import RunError
from skinrender.transport import tally


def ledger_of(rounds: int, power=POWER, seed: int = 1, histories=(50, 50, 50)) -> Ledger:
    ledger, fake = Ledger(power), FakePass(seed)
    for index in range(rounds):
        ledger.add(fake.walk(index, np.array(histories), True))
    return ledger


def test_batches_agree_with_the_textbook():
    values = np.random.default_rng(1).normal(size=(9, 4))
    batches = Batches()
    for row in values:
        batches.add(row)
    assert np.allclose(batches.stderr, values.std(axis=0, ddof=1) / 3, rtol=1e-12)


def test_fractions_sum_to_one():
    summary = summarize(ledger_of(40), [450, 500, 550], ("upper", "lower")).as_json()
    for part in (summary, *summary["by_wavelength"]):
        values = [part[name]["value"] for name in ("reflectance", "transmittance", "sides")]
        assert sum(values) + sum(v["value"] for v in part["absorbed"].values()) == pytest.approx(1, abs=4e-16)
    assert summary["lost"] == 0
    assert summary["photons_emitted"] == 40 * 150 == sum(b["photons_emitted"] for b in summary["by_wavelength"])
    json.dumps(summary, allow_nan=False)


def test_totals_are_weighted_by_the_light():
    ledger = ledger_of(40)
    reflected = ledger.fractions[:, tally.REFLECTED]
    assert ledger.total[tally.REFLECTED] == pytest.approx(reflected @ POWER / POWER.sum(), rel=1e-13)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_weights_bear_any_power(scale):
    assert np.array_equal(ledger_of(3, POWER * scale).total, ledger_of(3).total)


def test_standard_error_is_the_scatter_between_runs():
    """z of 60 independent runs against the known reflectance 0.2: their variance is 1 within chance."""
    z = []
    for seed in range(60):
        ledger = ledger_of(40, seed=seed)
        z.append((ledger.total[tally.REFLECTED] - 0.2) / ledger.total_stderr[tally.REFLECTED])
    assert abs(np.mean(z)) < 4 / np.sqrt(60)
    assert 0.55 < np.var(z) < 1.8


def test_impossible_and_certain_fates_are_exact():
    ledger = ledger_of(33, histories=(7, 7, 7))
    assert ledger.total[tally.SIDES] == 0 == ledger.total_stderr[tally.SIDES]
    assert np.all(ledger.fractions[:, tally.EMITTED] == 1)


def test_one_round_has_no_error_to_tell():
    summary = summarize(ledger_of(1), [450, 500, 550], ("upper", "lower")).as_json()
    assert summary["reflectance"]["stderr"] is None


def test_unused_bands_count_for_nothing():
    ledger = ledger_of(33, histories=(50, 0, 50))
    assert np.all(ledger.fractions[1] == 0)
    assert ledger.total[tally.EMITTED] == 1


def test_photons_that_do_not_add_up_are_an_error():
    walked = FakePass(1).walk(0, np.array([5, 5, 5]), True)
    walked.tallies[1, tally.SIDES] += 1
    with pytest.raises(RunError, match="-1 photons are unaccounted"):
        Ledger(POWER).add(walked)


def test_counting_light_stores_nothing_and_meets_its_target():
    summary = count_light(FakeRecipe(), 5, np.full(3, 100), StandardError(0.01, every_band=True))
    assert summary.stored == 0
    assert summary.fractions_stderr[:, tally.REFLECTED].max() <= 0.01
    assert abs(summary.total[tally.REFLECTED] - 0.2) < 4 * summary.total_stderr[tally.REFLECTED]
