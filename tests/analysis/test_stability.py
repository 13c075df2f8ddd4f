"""The stiff and extreme cases: the fast ones here, all of them by `make stability`."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from command_line import call, summary_of
from scipy import stats

from skinrender.analysis.closed_forms import (
    clear_stack,
    conservative_transmittance,
    h_function,
    half_space_diffuse_reflectance,
    half_space_radiance,
    half_space_reflectance,
)
from skinrender.analysis.stability import Found, all_cases, planned_cases, run_cases, write_cases
from skinrender.analysis.stability_case import Case, Measure, measure
from skinrender.analysis.stability_judges import expects, same_share, shows
from skinrender.analysis.stability_page import write_page
from skinrender.analysis.stability_scenes import half_space, layer, slab
from skinrender.errors import InputError

FAST = (
    "neither absorption*", "g = 0*", "index 1 + 1e-9*", "grazing light, *", "1 um of ink*", "a map of one*", "no light*",
    "light beyond*", "pictures of one*", "grazing camera*",
)  # fmt: skip


def test_half_space_is_that_of_chandrasekhars_tables():
    """H of albedo 1 and 0.9 at cosine 1; isotropic slabs of the truth tables."""
    assert h_function(1.0, 1.0) == pytest.approx(2.90781, abs=1e-5)
    assert h_function(0.0, 0.3) == pytest.approx(1.0)
    assert half_space_reflectance(0.95) == pytest.approx(0.5355409892, abs=1e-9)
    assert half_space_diffuse_reflectance(0.95) == pytest.approx(0.5966687802, abs=1e-6)


def test_radiance_of_a_half_space_adds_up_to_its_reflectance():
    nodes, weights = np.polynomial.legendre.leggauss(40)
    mu = 0.5 * (nodes + 1.0)
    flux = sum(w * math.pi * m * half_space_radiance(0.9, m) for w, m in zip(weights, mu))
    assert flux == pytest.approx(half_space_reflectance(0.9), rel=1e-5)


def test_thick_conservative_slab_transmits_in_inverse_proportion():
    assert conservative_transmittance(100.0) * 101.4209 == pytest.approx(1.6788, abs=1e-3)


def test_clear_stack_is_a_known_plate():
    reflected, passed, absorbed = clear_stack([0.0], [1.0, 1.5, 1.0])
    assert (reflected, passed) == pytest.approx((2 * 0.04 / 1.04, 0.96 / 1.04)) and absorbed == pytest.approx([0.0])
    reflected, passed, absorbed = clear_stack([0.21, 0.2], [1.0, 1.4, 1.33, 1.5])
    assert (reflected, passed) == pytest.approx((0.02968645385, 0.6425016547))
    assert reflected + passed + absorbed.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("few", [True, False])
def test_same_share_is_a_normal_score(few):
    rng, n = np.random.default_rng(1), 10_000
    p = 5e-4 if few else 0.3
    z = [abs(same_share(*rng.binomial([n, 3 * n], p), n, 3 * n)) for _ in range(2000)]
    above = np.mean(np.array(z) > 2.0)
    assert above < 2 * stats.norm.sf(2.0) + 0.015 and above > 0.01
    assert abs(same_share(0, 200, n, n)) > 4.0 and abs(same_share(3000, 3300, n, n)) > 4.0


def test_names_differ_and_every_case_says_what_could_break():
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names) >= 40
    assert all(case.could_break for case in all_cases())


@pytest.mark.parametrize("pattern", FAST)
def test_fast_cases_hold(pattern):
    found = run_cases(planned_cases(pattern), workers=1)
    assert [(one.case, one.decisive) for one in found if not one.ok] == []


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(all_cases())), ids=lambda number: all_cases()[number].name)
def test_all_cases_hold_with_another_seed(number):
    [found] = run_cases([number], seed=7, workers=1)
    assert found.ok, found.decisive


def test_a_wrong_truth_is_found():
    """Off by 2 % of the light, and by 5 % of the radiance."""
    scene = slab(half_space(0.5, 10.0, 60.0))
    reflected, radiance = half_space_reflectance(0.5), half_space_radiance(0.5, 1.0)
    right = Case("right", "-", [scene], lambda o: [*expects({"reflectance": reflected})(o), *shows(radiance)(o)])
    wrong = Case(
        "right", "-", [scene], lambda o: [*expects({"reflectance": reflected + 0.02})(o), *shows(1.05 * radiance)(o)]
    )
    assert all(one.ok for one in measure(right, 1))
    assert [one.quantity for one in measure(wrong, 1) if not one.ok] == [
        "z of reflectance", "z of the beam radiance", "z of the point radiance",
    ]  # fmt: skip


def test_a_case_that_fails_is_off_and_says_why():
    broken = Case("-", "-", [slab(layer(1.0, 1.0, 1.0), columns=0)], lambda outcomes: [])
    [found] = measure(broken, 1)
    assert not found.ok and "columns" in found.quantity


def test_not_a_number_is_off():
    assert not Measure("-", math.nan, 1.0).ok and not Measure("-", math.inf, 1.0).ok


def test_unknown_case_is_told():
    with pytest.raises(InputError, match="grazing camera"):
        planned_cases("nonsense*")


def test_table_has_a_row_for_each_measure(tmp_path):
    found = run_cases(planned_cases("neither abs*"), workers=1)
    write_cases(tmp_path / "check.csv", found)
    with open(tmp_path / "check.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found[0].measures) > 2
    assert {row["ok"] for row in rows} == {"True"} and rows[0]["case"] == found[0].case


def test_command_prints_the_cases(tmp_path):
    told = summary_of(call("check", "--only", "neither abs*", "-o", tmp_path, "--workers", "1", "--json"))
    [case] = told["cases"]
    assert told["ok"] and case["ok"] and case["measured"] <= case["bound"]
    assert {"case", "could_break", "measured", "bound", "ok"} <= case.keys()
    result = call("check", "--only", "neither abs*", "-o", tmp_path, "--workers", "1")
    assert result.exit_code == 0 and "0/0 albedo" in result.stdout and "bound" in result.stdout


def test_command_fails_when_a_case_is_off(tmp_path, monkeypatch):
    from skinrender.analysis import stability

    off = Case("off", "-", [], lambda outcomes: [Measure("nothing", 1.0, 0.0)])
    monkeypatch.setattr(stability, "all_cases", lambda: (off,))
    result = call("check", "-o", tmp_path, "--workers", "1")
    assert result.exit_code == 1 and "OFF" in result.stdout and "off" in result.stderr
    assert call("check", "--only", "nonsense", "-o", tmp_path).exit_code == 2


def test_page_lists_every_case_with_its_verdict(tmp_path):
    """Parsed as a browser would; one case is off, which must show in words."""
    right = Found(all_cases()[0].name, "nothing", (Measure("z", 1.0, 4.0), Measure("lost", 0.0, 0.0)), 1.5)
    wrong = Found("made up <&>", "all", (Measure("z", 9.0, 4.0),), 0.5)
    write_page(tmp_path / "check.html", [right, wrong], 7)
    text = (tmp_path / "check.html").read_text(encoding="utf-8")
    assert "2 cases, 3 measures: 1 of them off" in text and "made up &lt;&amp;&gt;" in text
    assert text.count("<tr class=good>") == 1 and text.count("<tr class=bad>") == 1
    assert "<td>OFF</td>" in text and "<script" not in text and "src=" not in text
    assert "Optics of the tissue" in text
