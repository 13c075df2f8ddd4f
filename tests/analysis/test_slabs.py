"""Reading truth files, scores of counts, the number of histories, and the command."""

from __future__ import annotations

import csv
import json
import math
from copy import deepcopy
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call, summary_of
from scipy import stats

from skinrender.analysis.slab_bins import critical_cosines, depth_bins, half_width, vertical_cosine
from skinrender.analysis.slab_stats import distribution, events, fraction
from skinrender.analysis.slab_truth import Layer, SlabRecord, Stack, read_truth
from skinrender.analysis.slab_walk import (
    LEAST_HISTORIES,
    MOST_EVENTS,
    Accuracy,
    parts,
    planned_histories,
    record_seed,
    stack_scene,
)
from skinrender.analysis.slabs import check_slabs
from skinrender.errors import InputError

# van de Hulst 1980, by adding-doubling
RECORD = {
    "id": "slab/normal",
    "layers": [{"thickness_mm": 0.2, "mu_a": 1, "mu_s": 9, "g": 0.75, "n": 1.0}],
    "n_above": 1,
    "n_below": 1,
    "incidence": "normal",
    "R_total": 0.09739463867,
    "T_total": 0.6609577002,
    "R_unscattered": 0.0,
    "T_unscattered": 0.1353352832,
    "A_layers": [0.2416476612],
    "scatter_events": [2.17482895],
    "accuracy": {"abs": 1e-11, "rel_max": 1e-9},
}
TWO_LAYERS = Stack((Layer(1.0, 0.1, 9.9, 0.8, 1.5), Layer(2.0, 0.0, 0.0, 0.0, 1.33)), 1.0, 1.0, "normal")
COARSE = ("--stderr", "0.03")


@pytest.fixture
def write(tmp_path):
    """Writes a truth file of records; returns its path."""

    def write_file(*records, schema="layered-slab-truth/1"):
        path = tmp_path / "truth.json"
        path.write_text(json.dumps({"schema": schema, "records": records}))
        return path

    return write_file


def test_score_of_a_fraction_is_in_standard_errors_under_the_expected_value():
    result = fraction("a", "R_total", 0.2, 0.003, 2300, 10_000)
    assert result.stderr == pytest.approx(math.hypot(0.004, 0.003))
    assert result.z == pytest.approx(0.03 / 0.005)
    assert not result.ok and result.as_json()["ok"] is False


@pytest.mark.parametrize("count", [0, 3, 10, 40])
def test_few_expected_counts_are_scored_by_the_binomial_tail(count):
    few, spared = fraction("a", "T", 1e-3, 0.0, count, 10_000), fraction("a", "T", 0.999, 0.0, 10_000 - count, 10_000)
    tail = stats.binom.cdf(count, 10_000, 1e-3) if count <= 10 else stats.binom.sf(count - 1, 10_000, 1e-3)
    assert stats.norm.sf(abs(few.z)) == pytest.approx(min(tail, 0.5), rel=1e-6)
    assert np.sign(few.z) == np.sign(count - 10) or tail > 0.5
    assert spared.z == pytest.approx(-few.z, abs=1e-6)


def test_what_is_expected_never_or_always_must_be_so():
    assert fraction("a", "T", 0.0, 1e-11, 0, 1000).ok and fraction("a", "T", 1.0, 1e-11, 1000, 1000).ok
    assert fraction("a", "T", 0.0, 1e-11, 1, 1000).z == math.inf
    assert fraction("a", "T", 1.0, 1e-11, 999, 1000).z == -math.inf
    assert fraction("a", "T", 1e-30, 1e-11, 0, 1000).ok


def test_events_are_scored_by_the_spread_of_the_rounds():
    result = events("a", "scatter_events[0]", 4.0, 0.0, 4.2, 0.1, 1000)
    assert result.z == pytest.approx(0.2 / (0.1 * math.sqrt(4.0 / 4.2)))
    assert events("a", "fluence", 4.0, 0.0, 4.2, 0.1, 1000, unit=2.0).expected == 2.0
    assert events("a", "S", 0.0, 0.0, 0.0, 0.0, 1000).ok and not events("a", "S", 0.0, 0.0, 1e-3, 1e-3, 1000).ok


def test_rare_bursts_of_events_are_no_surprise():
    """One history in 5000 scatters 100 times: none, one and three of them in 5000 are as likely as they are."""
    histories, expected = 5000, 0.02
    for bursts in (0, 1, 3):
        got = expected * bursts
        stderr = math.sqrt(bursts) * expected
        result = events("a", "S", expected, 0.0, got, stderr, histories, burst=100.0)
        assert abs(result.z) < 2.0
    assert abs(events("a", "S", expected, 0.0, 12 * expected, math.sqrt(12) * expected, histories).z) > 4.0


def test_scores_of_true_hypotheses_are_standard_normal():
    rng = np.random.default_rng(1)
    z = [fraction("a", "R", p, 0.0, int(rng.binomial(5000, p)), 5000).z for p in rng.uniform(0.1, 0.9, 400)]
    found = distribution(z)
    assert found["count"] == 400 and found["p_chi2"] > 1e-3 and found["p_ks"] > 1e-3
    assert distribution(np.array(z) * 1.3)["p_chi2"] < 1e-3
    assert distribution(np.array(z) + 0.3)["p_ks"] < 1e-3
    assert distribution([1.0])["p_ks"] is None


def fake_walk(variance: float):
    """Pilots of a layer with one event a history in the mean and the given variance; keeps the sizes asked for."""
    asked = []

    def walk(number, histories):
        asked.append(histories)
        stderr = np.zeros((1, 12))
        stderr[0, 11] = math.sqrt(variance / histories)
        return SimpleNamespace(fractions_stderr=stderr, emitted=histories)

    return walk, asked


def test_histories_follow_from_the_fractions_where_events_are_easy():
    walk, asked = fake_walk(1.0)
    assert planned_histories(walk, [0.5, 0.9], [0.5], Accuracy(1e-3, 0.02)) == (math.ceil(0.25 / 0.9e-3**2), False)
    assert asked == []
    assert planned_histories(walk, [1.0], [0.0], Accuracy(1e-3, 0.02))[0] == LEAST_HISTORIES


def test_histories_follow_from_a_pilot_that_knows_the_variance():
    walk, asked = fake_walk(1e3)
    histories, is_limited = planned_histories(walk, [0.5], [1.0], Accuracy(1e-3, 0.02))
    assert histories == pytest.approx(1e3 / (0.75 * 0.02) ** 2, rel=1e-3) and not is_limited
    assert len(asked) == 2 and math.sqrt(1e3 / asked[-1]) <= 0.07


def test_histories_are_limited_by_the_scatterings_they_cost():
    walk, asked = fake_walk(1e12)
    assert planned_histories(walk, [0.5], [1e4], Accuracy(1e-3, 0.02)) == (int(MOST_EVENTS / 1e4), True)
    assert max(asked) <= MOST_EVENTS / 1e4


def test_records_have_photons_of_their_own():
    assert len({record_seed(1, "a"), record_seed(2, "a"), record_seed(1, "b"), record_seed(1, "a", 1)}) == 4
    assert record_seed(1, "a") == record_seed(1, "a") < 2**63


def test_scene_of_a_stack_is_its_layers_whole_or_cut():
    record = SlabRecord({}, "file: record 'a'", "a", TWO_LAYERS)
    scene = stack_scene(record, cuts_mm=[0.25, 1.0, 2.0, 7.0])
    assert [layer.thickness_mm for layer in scene.slab.layers] == pytest.approx([0.25, 0.75, 1.0, 1.0])
    assert [index for index, *_ in parts(TWO_LAYERS, [0.25, 1.0, 2.0, 7.0])] == [0, 0, 1, 1]
    assert (scene.light.kind, scene.sides, scene.below.refractive_index) == ("collimated", "periodic", 1.0)
    assert stack_scene(record, pencil=True).light.radius_mm == 0.0


def test_bins_are_narrow_where_the_values_bend():
    x = np.linspace(0.0, 1.0, 11)
    assert half_width(x, 2.0 + x, 5) > 1e3
    half = half_width(x, np.exp(5.0 * x), 5)
    bend = np.sinh(5.0 * half) / (5.0 * half) - 1.0
    assert 3e-4 < bend < 1.1e-3
    bins = depth_bins(TWO_LAYERS, [0.001, 0.5, 2.0], [0, 0, 1], np.ones(3))
    assert bins[0].low > 0.0 and bins[1].width == pytest.approx(2 * 0.05 / 10.0)


def test_total_reflection_begins_at_the_critical_cosines():
    expected = [math.sqrt(1.0 - (1.33 / 1.5) ** 2), math.sqrt(1.0 - (1.0 / 1.5) ** 2)]
    assert sorted(critical_cosines(TWO_LAYERS, 0)) == pytest.approx(expected)
    assert critical_cosines(Stack((Layer(1.0, 0.0, 0.0, 0.0, 1.0),), 1.0, 1.0, "normal"), 0) == []


def test_cosines_of_packed_directions():
    from skinrender.transport.turn import pack_direction

    u = np.random.default_rng(1).normal(size=(50, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    packed = np.array([pack_direction(*row) for row in u.astype(np.float32)], np.int32)
    assert vertical_cosine(packed.view(np.uint16).reshape(-1, 2)) == pytest.approx(u[:, 2], abs=1e-4)


def test_records_are_chosen_by_pattern_or_beginning(write):
    path = write(RECORD, RECORD | {"id": "slab/diffuse"}, RECORD | {"id": "other"})
    for only, expected in ((None, 3), ("slab", 2), ("*diffuse", 1), ("other", 1)):
        assert len(read_truth(path, only).records) == expected
    with pytest.raises(InputError, match="no record matches 'none'\n.*slab/diffuse"):
        read_truth(path, "none")


def changed(**values):
    return {key: value for key, value in (deepcopy(RECORD) | values).items() if value is not ...}


def with_layer(**values):
    return changed(layers=[RECORD["layers"][0] | values])


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (changed(R_total=...), r"record 'slab/normal': R_total is missing"),
        (changed(R_total="much"), "R_total is 'much'"),
        (changed(R_total=1.5), "R_total is 1.5\n.*from 0 to 1"),
        (changed(T_total=float("nan")), "T_total is nan"),
        (changed(A_layers=[0.1, 0.2]), "A_layers has 2 values\n.*write 1"),
        (changed(A_layers=0.1), "A_layers is 0.1"),
        (changed(scatter_events=[None]), r"scatter_events\[0\] is missing"),
        (changed(n_above=True), "n_above is True"),
        (changed(incidence="oblique"), "incidence is 'oblique'\n.*normal or diffuse"),
        (changed(layers=[]), "layers is empty"),
        (changed(layers=[3]), r"layers\[0\]: is 3"),
        (changed(layers={}), "layers is an object"),
        (changed(accuracy={"abs": "fine"}), "accuracy.abs is 'fine'"),
        (changed(id=...), "record 0: id is missing"),
        (with_layer(g=1.0), r"layers\[0\]: g is 1\n.*between -1 and 1"),
        (with_layer(thickness_mm=0), "thickness_mm is 0"),
        (with_layer(mu_a=-1), "mu_a is -1"),
        (with_layer(n=50.0), "record 'slab/normal': no scene can be made of its layers\n.*refractive_index"),
        ("text", "record 0: is 'text'"),
    ],
)
def test_a_malformed_record_is_named_with_key_and_remedy(write, record, told):
    path = write(record)
    with pytest.raises(InputError, match=told) as caught:
        check_slabs(path)
    assert str(caught.value).startswith(str(path)) and "\n  " in str(caught.value)


@pytest.mark.parametrize("schema", ["slab-field-truth/1", "slab-radial-truth/1"])
def test_a_record_without_fields_is_named(write, schema):
    with pytest.raises(InputError, match="record 'slab/normal': .*(depth_columns|R_total_exact) is missing"):
        check_slabs(write(RECORD, schema=schema))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", r"truth.json:1:2: is not JSON"),
        ("[]", "is not a JSON object"),
        ("{}", "schema is missing\n.*layered-slab-truth/1"),
        ('{"schema": "slab/7"}', "schema is 'slab/7'\n.*layered-slab-truth/1"),
        ('{"schema": "layered-slab-truth/1"}', "records is missing"),
        ('{"schema": "layered-slab-truth/1", "records": []}', "there are no records"),
        ("[" * 100_000, "is nested too deeply|is not JSON"),
        ("\0\xff", "is not"),
    ],
)
def test_a_malformed_file_is_told(tmp_path, text, told):
    path = tmp_path / "truth.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=told):
        read_truth(path)


def test_a_file_that_is_absent_or_a_folder_is_told(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_truth(tmp_path / "none.json")
    with pytest.raises(InputError, match="is not a text file"):
        read_truth(tmp_path)


def test_an_id_that_comes_twice_is_told(write):
    with pytest.raises(InputError, match="the id 'slab/normal' twice"):
        read_truth(write(RECORD, RECORD))


def test_command_prints_results_and_writes_them(write, tmp_path):
    folder = tmp_path / "out"
    found = summary_of(call("check", "--slabs", write(RECORD), *COARSE, "-o", folder, "--json"))
    names = ["R_total", "T_total", "R_unscattered", "T_unscattered", "A_layers[0]", "scatter_events[0]"]
    assert found["ok"] is True and [row["quantity"] for row in found["results"]] == names
    assert set(found["results"][0]) == {"id", "quantity", "expected", "got", "stderr", "z", "ok"}
    with open(folder / "check.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["quantity"] for row in rows] == names
    assert float(rows[0]["got"]) == found["results"][0]["got"]


def test_command_fails_when_a_quantity_is_off(write, tmp_path):
    result = call("check", "--slabs", write(changed(R_total=0.2, R_unscattered=0.5)), *COARSE, "-o", tmp_path, "--json")
    assert result.exit_code == 1 and "2 of 6 quantities are off" in result.stderr
    found = json.loads(result.stdout)
    assert found["ok"] is False
    assert [row["quantity"] for row in found["results"] if not row["ok"]] == ["R_total", "R_unscattered"]
    table = call("check", "--slabs", write(changed(R_total=0.2)), *COARSE, "-o", tmp_path)
    assert "slab/normal R_total" in table.stdout and "NO" in table.stdout


def test_command_refuses_bad_files(write, tmp_path):
    result = call("check", "--slabs", write(changed(T_total=...)), "-o", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "record 'slab/normal': T_total is missing" in result.stderr
    assert not (tmp_path / "out").exists()


def test_results_depend_on_the_seed_alone(write):
    path = write(RECORD, RECORD | {"id": "again"})
    wanted = Accuracy(0.03, 0.6)
    both = check_slabs(path, wanted=wanted, workers=1).results
    assert check_slabs(path, wanted=wanted, workers=1, only="again").results == both[6:]
    assert [r.got for r in both[:6]] != [r.got for r in both[6:]]
    assert check_slabs(path, wanted=wanted, workers=1, seed=2).results != both
