"""Size of the rounds, and when they end."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from fake_pass import POWER, FakePass

from skinrender.engine.ledger import Ledger
from skinrender.engine.rounds import (
    LEAST_SHARE,
    PILOT_HISTORIES,
    PILOT_ROUNDS,
    PILOT_SEED,
    ROUND_HISTORIES_MAX,
    ROUND_STORED_MAX,
    Pilot,
    plan_rounds,
    rounds_until,
    run_pilot,
    uniform_share,
    visible_share,
)
from skinrender.engine.stop import MIN_ROUNDS, StandardError, StoredCount

SHARE = np.ones(3)


def pilot_of(stored: float) -> Pilot:
    return Pilot(np.full(3, stored), 0.01, 1.5)


def test_pilot_measures_photons_stored_per_history():
    """The fake stores 0 to 7 photons a history, evenly: mean 3.5, variance 5.25."""
    pilot = run_pilot(FakePass(PILOT_SEED), SHARE)
    assert np.all(np.abs(pilot.stored - 3.5) < 5 * np.sqrt(5.25 / (PILOT_ROUNDS * (PILOT_HISTORIES // 3))))
    assert 0.3 < pilot.relative_spread / (np.sqrt(5.25) / 3.5) < 2
    assert pilot.relative_stderr < 0.01


def test_bands_without_power_are_left_out():
    share = uniform_share([1.0, 0.0, 2.0])
    pilot = run_pilot(FakePass(PILOT_SEED), share)
    assert plan_rounds(pilot, share, 10_000).histories[1] == 0
    assert pilot.stored[1] == 0


def test_visible_bands_get_more_histories_and_dark_ones_none():
    wavelength_nm = np.arange(380.0, 781.0, 5.0)
    power = np.where(wavelength_nm < 700, 1.0, 0.0)
    share = visible_share(power, wavelength_nm)
    assert share.max() == 1.0 and 520 <= wavelength_nm[np.argmax(share)] <= 560
    assert share[0] == LEAST_SHARE and np.all(share[power == 0] == 0) and np.all(share[power > 0] >= LEAST_SHARE)
    assert np.array_equal(visible_share(np.ones(1), np.array([550.0])), [1.0])
    assert np.array_equal(visible_share(np.ones(2), np.array([700.0, 750.0])), [1.0, 1.0]), "no color: all alike"


@pytest.mark.parametrize("wanted", [10_000, 1e6, 324e6])
def test_about_forty_rounds_reach_the_wanted_count(wanted):
    plan = plan_rounds(pilot_of(90.0), SHARE, int(wanted))
    assert 32 <= plan.rounds_expected <= 42
    assert plan.stored_expected == pytest.approx(wanted, rel=0.06)


@pytest.mark.parametrize("stored", [90.0, 1e-7, 1e9])
@pytest.mark.parametrize("wanted", [0, 1, 10**4, 10**8, 10**11])
def test_a_round_is_never_empty_and_never_too_large(stored, wanted):
    plan = plan_rounds(pilot_of(stored), SHARE, wanted)
    assert plan.histories.min() >= 1
    assert plan.histories.sum() <= ROUND_HISTORIES_MAX + 3
    assert plan.stored_per_round <= max(ROUND_STORED_MAX, plan.histories.max() * 0 + 3 * stored) * 1.5
    assert plan.rounds_enough >= plan.rounds_expected >= MIN_ROUNDS


def test_scene_without_scattering_wants_no_photons():
    plan = plan_rounds(pilot_of(0.0), SHARE, 10**7)
    assert plan.stored_wanted == 0 and plan.rounds_enough == MIN_ROUNDS
    assert plan.histories.sum() >= PILOT_HISTORIES, "its fractions would not be known"


def walked(stop, histories=20, power=POWER) -> Ledger:
    ledger, fake = Ledger(power), FakePass(1)
    rounds = rounds_until(stop, lambda i: fake.walk(i, np.full(3, histories), True), itertools.count(), ledger)
    assert sum(1 for _ in rounds) == len(ledger.rounds)
    return ledger


def test_stored_count_stops_after_the_round_that_reaches_it():
    ledger = walked(StoredCount(10_000))
    assert ledger.stored >= 10_000 > ledger.stored - ledger.rounds[-1].stored_per_band.sum()


def test_no_stop_before_there_are_batches_enough():
    assert len(walked(StoredCount(1)).rounds) == MIN_ROUNDS
    assert len(walked(StandardError(1.0)).rounds) == MIN_ROUNDS


def test_standard_error_of_every_band_takes_longer_than_that_of_the_total():
    total, every = walked(StandardError(0.012)), walked(StandardError(0.012, every_band=True))
    assert len(total.rounds) < len(every.rounds)
    assert every.fractions_stderr[:, 1].max() <= 0.012


def test_scattering_events_are_relative():
    """Mean 3.5, deviation 2.29: 2 % takes 1070 histories of one weight; the layer without events asks for none."""
    ledger = walked(StandardError(1.0, events_relative=0.02), power=np.ones(3))
    assert 500 < ledger.counts[:, 0].sum() < 2600
