"""What is compared, and the time budget."""

from __future__ import annotations

from pathlib import Path

import pytest

from skinrender.analysis.error_budget import Budget, Pace
from skinrender.analysis.error_study import Method, Study, bench_hash, count_text, make_subjects
from skinrender.errors import InputError
from skinrender.scene import make_scene

LAYER = {"thickness_mm": 1, "mu_a_per_mm": 1, "mu_s_per_mm": 5, "g": 0.5, "refractive_index": 1.4}


def scene(**parts):
    data = {"name": "slab", "patch": {"size_mm": [1, 1], "columns": [1, 1]}, "slab": {"layers": [LAYER]}}
    return make_scene(data | parts)


def subject(**parts):
    return make_subjects([(scene(**parts), Path("slab.yaml"))])[0]


def test_methods_are_written_with_their_gather_count():
    assert Method.parse("beam") == Method("beam")
    assert Method.parse("point:3e4") == Method("point", 30000)
    assert Method.parse("point:30000").label == "point, K = 30000"


@pytest.mark.parametrize("text", ["path", "beam:", "beam:many", "beam:0", "beam:1.5", "beam:nan", "beam:inf", "reference:9", ""])
def test_methods_that_are_none_are_told(text):
    with pytest.raises(InputError, match="--method"):
        Method.parse(text)


def test_usual_counts_span_three_decades_down_from_the_scenes_own():
    study = Study(())
    assert study.counts_of(subject(photons={"stored": 5e7})) == (50_000, 500_000, 5_000_000, 50_000_000)
    assert study.counts_of(subject(photons={"stored": 5000})) == (100, 500, 5000)
    assert study.counts_of(subject(photons={"stored": 7})) == (7,)
    assert Study((), counts=(100, 10, 100)).counts_of(subject()) == (10, 100)


def test_a_scene_is_the_same_whatever_its_photons_and_method():
    one = subject(photons={"stored": 10, "seed": 3}, estimate={"method": "point"})
    assert one.identity == subject().identity
    assert one.identity != subject(camera={"pixels": [8, 8]}).identity
    assert one.identity != subject(estimate={"gather_count": 8}).identity
    assert Study((), seeds=2).seeds_of(one) == (3, 4)
    assert Study((), seeds=2).seeds_of(subject(photons={"seed": 2**63 - 1})) == (2**63 - 1, 0)


def test_labels_are_unique_and_scenes_stand_once():
    path = Path("a.yaml")
    first, second = make_subjects([(scene(), path), (scene(camera={"pixels": [8, 8]}), path)])
    assert first.label == "slab" and second.label.startswith("slab (")
    with pytest.raises(InputError, match="stands twice"):
        make_subjects([(scene(), path), (scene(photons={"stored": 5}), path)])


def test_times_on_another_number_of_workers_are_others():
    assert bench_hash(1) == bench_hash(1) != bench_hash(2)


def test_counts_are_short():
    assert [count_text(count) for count in (7, 1e4, 3.2e7, 1e12)] == ["7", "1e4", "3.2e7", "1e12"]


def test_pace_is_a_line_through_the_largest_runs():
    pace = Pace()
    assert not pace
    pace.add(1000, 1.0)
    assert pace.law.at(2000) == pytest.approx(2.0)
    pace.add(2000, 1.5)
    assert pace.law.at(10_000) == pytest.approx(5.5)
    assert pace.photons_within(5.5) == pytest.approx(10_000)
    pace.add(4000, 1.4)  # by chance faster than the smaller one
    assert pace.law.at(8000) == pytest.approx(2.8)


def test_a_budget_allows_what_will_end_in_time():
    free, tight = Budget(None), Budget(10.0)
    for budget in (free, tight):
        budget.pace("slab").add(1000, 1.0)
    assert free.allows("slab", 10**9)
    assert tight.allows("slab", 5000) and not tight.allows("slab", 20_000)
    assert tight.allows("unknown yet", 10**9)
    assert free.reference_photons("slab", 10**6, 10, 1) == 10**6
    assert tight.reference_photons("slab", 10**6, 10, 1) == pytest.approx(4000, rel=0.01)
    assert tight.reference_photons("slab", 10**6, 10, 2) == pytest.approx(2000, rel=0.01)
    assert tight.reference_photons("slab", 10**6, 5000, 1) == 5000
