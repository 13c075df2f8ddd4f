from __future__ import annotations

import numpy as np
import pytest

from skinrender.analysis.light_counts import (
    ROUNDS,
    LightCounts,
    balance,
    controlled_mean,
    count_rounds,
    settle_histories,
)
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.transport import tally
from tests.volumes import Layer, beam, slab_volume

SKINNY = [Layer(0.1, 1.0, 20.0), Layer(1.0, 0.1, 15.0)]
HISTORIES = np.array([400])


@pytest.fixture(scope="module")
def slab():
    return slab_volume(SKINNY, columns=(4, 2))


@pytest.fixture(scope="module")
def counts(slab) -> LightCounts:
    left = np.zeros((4, 2), bool)
    left[:1] = True
    return count_rounds(PhotonPass(slab, beam(8.0), 1), HISTORIES, ROUNDS, regions=(left, ~left), workers=1)


def test_counts_do_not_depend_on_the_number_of_threads(slab, counts):
    again = count_rounds(PhotonPass(slab, beam(8.0), 1), HISTORIES, ROUNDS, workers=3)
    assert np.array_equal(again.tallies, counts.tallies)


def test_regions_share_what_left(counts):
    reflected = counts.tallies[..., tally.REFLECTED] - counts.tallies[..., tally.SPECULAR]
    assert np.array_equal(counts.exits.sum(axis=-1), reflected)


def test_a_uniform_patch_leaves_as_much_light_everywhere(counts):
    left, right = (counts.exits[:, 0, i].sum() for i in (0, 1))
    share = left / (left + right)
    assert abs(share - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / (left + right))


def test_absorption_is_what_the_collisions_let_expect(slab, counts):
    surplus = balance(slab, counts)[:, 0]
    assert abs(surplus.mean()) < 4.0 * surplus.std(ddof=1) / np.sqrt(ROUNDS)
    assert surplus.std() > 0


def test_uneven_layers_are_left_out(slab):
    from dataclasses import replace

    uneven = replace(
        slab, palette_layer=np.array([0, 1, 2, 2], np.uint8), mu_a=np.vstack([slab.mu_a, [[5.0]]]),
        mu_s=np.vstack([slab.mu_s, slab.mu_s[-1:]]),
    )  # fmt: skip
    tallies = np.zeros((2, 1, tally.columns(2)), np.int64)
    tallies[..., tally.absorbed(2)] = [3, 1000]
    one = LightCounts(np.array([10]), tallies, np.zeros((2, 1, 0)))
    assert balance(uneven, one)[:, 0] == pytest.approx((3 - 3 * 1.0 / 21.0) / 10)


def test_control_keeps_the_mean_and_takes_variance(slab):
    """A fifth of the variance, which from 2000 rounds is known to 0.02."""
    counts = count_rounds(PhotonPass(slab, beam(8.0), 1), HISTORIES, 2000, workers=1)
    reflected = counts.tallies[..., tally.REFLECTED, None] / counts.histories[:, None]
    mean, covariance = controlled_mean(reflected, balance(slab, counts))
    plain, error = reflected.mean(), reflected.std(ddof=1) / np.sqrt(len(reflected))
    assert covariance[0, 0, 0] < 0.9 * error**2
    assert abs(mean[0, 0] - plain) < 4.0 * np.sqrt(error**2 - covariance[0, 0, 0])


def test_controlled_errors_are_those_of_repetitions():
    rng = np.random.default_rng(1)
    control = rng.normal(size=(32, 500))
    values = np.stack([control + rng.normal(size=control.shape), 3.0 - control], axis=-1)
    mean, covariance = controlled_mean(values, control)
    assert mean[:, 1] == pytest.approx(np.full(500, 3.0))
    assert covariance[:, 1, 1] == pytest.approx(np.zeros(500), abs=1e-12)
    z = mean[:, 0] / np.sqrt(covariance[:, 0, 0])
    assert abs(z.mean()) < 4.0 / np.sqrt(500)
    assert 0.8 < z.var() < 1.35


def test_histories_follow_from_the_wanted_error(slab):
    coarse, fine = (settle_histories(PhotonPass(slab, beam(8.0), 7), stderr) for stderr in (0.02, 0.005))
    assert fine[0] == pytest.approx(16 * coarse[0], rel=0.1)


def test_the_wanted_error_is_reached(slab):
    histories = settle_histories(PhotonPass(slab, beam(8.0), 7), 0.01)
    counts = count_rounds(PhotonPass(slab, beam(8.0), 1), histories, ROUNDS, workers=1)
    reflected = counts.tallies[..., tally.REFLECTED, None] / counts.histories[:, None]
    mean, covariance = controlled_mean(reflected, balance(slab, counts))
    assert np.sqrt(covariance[0, 0, 0]) / mean[0, 0] == pytest.approx(0.01, rel=0.35)
