"""The walk against radial profiles of a pencil beam: R(rho), R by cosine, fluence by depth."""

from __future__ import annotations

import pytest

from skinrender.analysis.slab_walk import Accuracy
from skinrender.analysis.slabs import CONTRACT, check_slabs

TRUTH = "tests/truth"


def test_profiles_under_a_pencil_beam(repository):
    path = repository / TRUTH / "slab_radial.json"
    found = check_slabs(path, only="pub1*", wanted=Accuracy(3e-3, 0.06), seed=5, workers=1)
    assert len(found.results) == 2 + 80 + 20 + 60
    assert [result for result in found.results if not result.ok] == []


@pytest.mark.slow
def test_the_whole_file(repository):
    found = check_slabs(repository / TRUTH / "slab_radial.json", wanted=CONTRACT)
    assert [result for result in found.results if not result.ok] == []
