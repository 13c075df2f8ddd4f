"""The walk against truths of layered slabs: totals, unscattered parts, absorption and scattering events by layer."""

from __future__ import annotations

import math

import pytest

from skinrender.analysis.slab_walk import Accuracy
from skinrender.analysis.slabs import CONTRACT, check_slabs

TRUTH = "tests/truth"
COARSE = Accuracy(fraction=3e-3, events=0.06)


@pytest.fixture(scope="module")
def coarse(repository):
    """All records of the file, with a tenth of the histories that the contract asks for."""
    return check_slabs(repository / TRUTH / "layered_slabs.json", wanted=COARSE, seed=11, workers=1)


def test_every_quantity_is_within_four_standard_errors(coarse):
    assert len(coarse.results) == 312
    assert [result for result in coarse.results if not result.ok] == []


def test_z_of_reflectance_is_distributed_as_it_should_be(coarse):
    spread = coarse.as_json()["R_total_z"]
    assert spread["count"] == 36
    assert spread["p_chi2"] > 1e-3 and spread["p_ks"] > 1e-3


def test_standard_errors_are_as_wanted(coarse):
    for result in coarse.results:
        if not result.quantity.startswith("scatter"):
            assert result.stderr <= COARSE.fraction
        elif result.expected >= 1.0:
            assert result.stderr <= COARSE.events * result.expected


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_whole_file_at_the_accuracy_of_the_contract(repository, seed):
    found = check_slabs(repository / TRUTH / "layered_slabs.json", wanted=CONTRACT, seed=seed)
    assert [result for result in found.results if not result.ok] == []
    spread = found.as_json()["R_total_z"]
    assert min(spread["p_chi2"], spread["p_ks"]) > 1e-3
    for result in found.results:
        bound = math.inf if result.expected < 1.0 else CONTRACT.events * result.expected
        assert result.stderr <= (bound if result.quantity.startswith("scatter") else CONTRACT.fraction)
