"""The walk against fields in layered slabs: fluence, net flux, radiance inside and outside."""

from __future__ import annotations

import pytest

from skinrender.analysis.slab_walk import Accuracy
from skinrender.analysis.slabs import CONTRACT, check_slabs

TRUTH = "tests/truth"
COARSE = Accuracy(fraction=3e-3, events=0.06)


@pytest.mark.parametrize("record", ["vdh-slab/diffuse", "pub3/normal"])
def test_fields_of_a_matched_slab_and_of_three_layers(repository, record):
    found = check_slabs(repository / TRUTH / "slab_fields.json", only=record, wanted=COARSE, seed=5, workers=1)
    kinds = {result.quantity.partition("[")[0] for result in found.results}
    assert kinds == {
        "R_total", "T_total", "fluence_total", "flux_net", "exit_radiance_top", "radiance_down", "radiance_up",
    }  # fmt: skip
    assert [result for result in found.results if not result.ok] == []


@pytest.mark.slow
def test_the_whole_file(repository):
    found = check_slabs(repository / TRUTH / "slab_fields.json", wanted=CONTRACT)
    assert len(found.results) > 1800
    assert [result for result in found.results if not result.ok] == []
