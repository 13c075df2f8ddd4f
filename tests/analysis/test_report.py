"""A whole report on a tiny slab: what is run, kept, run again, and shown."""

from __future__ import annotations

import csv
import math
import os
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from skinrender.analysis import error_runs
from skinrender.analysis.error_levels import UNKNOWN, Level, make_series
from skinrender.analysis.error_rows import RowFile
from skinrender.analysis.error_stats import Uncertain
from skinrender.analysis.error_study import Method, Study, make_subjects
from skinrender.analysis.report import report
from skinrender.analysis.report_findings import gather_findings
from skinrender.analysis.report_page import report_page
from skinrender.engine.interrupt import Interrupted
from skinrender.errors import InputError
from skinrender.scene import make_scene

NAME = "<script>alert(1)<b>&$x_{$"
LAYER = {"thickness_mm": 1, "mu_a_per_mm": 1, "mu_s_per_mm": 5, "g": 0.5, "refractive_index": 1.4}
SCENE = {
    "name": NAME,
    "patch": {"size_mm": [2, 2], "columns": [1, 1]},
    "bands_nm": [550],
    "slab": {"layers": [LAYER]},
    "camera": {"pixels": [8, 8]},
}


def study(**changes):
    subjects = make_subjects([(make_scene(SCENE), Path("slab.yaml"))])
    return replace(Study(subjects, counts=(1000, 4000), seeds=2, reference_photons=20_000, workers=1), **changes)


def ran(out, **changes):
    """The runs alone, without their page."""
    return error_runs.StudyRun(study(**changes), out, progress=False).run()


@pytest.fixture(scope="module", autouse=True)
def without_waiting_for_the_disk():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="module")
def first(tmp_path_factory, without_waiting_for_the_disk):
    out = tmp_path_factory.mktemp("report")
    return out, report(study(), out, command="skinrender report <slab>", progress=False)


@pytest.fixture
def copied(first, tmp_path):
    return shutil.copytree(first[0], tmp_path / "copied")


def rows_of(out):
    with open(out / "error_vs_time.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def run_of(row):
    return row["method"], row["photons"], row["seed"]


def errors_of(row):
    return {name: float(row[name]) for name in ("rmse", "relmse", "bias", "ssim", "delta_e_mean")}


def test_every_run_is_a_row_and_a_picture(first):
    out, found = first
    rows = rows_of(out)
    assert len(rows) == found.outcome.new_rows == 2 * 2 * 2
    assert all((out / row["picture"]).is_file() for row in rows)
    for row in rows:
        stages = [float(row[f"{stage}_s"]) for stage in ("load", "trace", "estimate", "write")]
        assert all(spent > 0 for spent in stages) and math.isclose(sum(stages), float(row["total_s"]), rel_tol=1e-4)
    shared = {(row["photons"], row["seed"]): set() for row in rows}
    for row in rows:
        shared[row["photons"], row["seed"]].add(row["trace_s"])
    assert all(len(seconds) == 1 for seconds in shared.values()), "the methods of a seed share its trace"


def test_temporary_files_are_gone(first):
    left = {path.name for path in (first[0] / "report").iterdir()}
    assert left == {"index.html", "pictures", "plots", "references"}
    assert not list(first[0].rglob("photons.npz")) and not list(first[0].rglob("*.part*"))


def test_what_is_there_is_not_run_again(copied, monkeypatch):
    monkeypatch.setattr(error_runs, "Bench", None)
    again = ran(copied)
    assert again.new_rows == 0 and len(again.rows) == 8


def test_half_of_the_rows_are_made_again_to_the_same_errors(copied):
    before = rows_of(copied)
    path = copied / "error_vs_time.csv"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:5]) + lines[5][:30], encoding="utf-8")
    assert ran(copied).new_rows == 4
    for row, old in zip(sorted(rows_of(copied), key=run_of), sorted(before, key=run_of), strict=True):
        # the reference has been through a file of float32
        assert run_of(row) == run_of(old) and errors_of(row) == pytest.approx(errors_of(old), rel=1e-5)


def test_a_lost_picture_is_taken_again(copied):
    (copied / rows_of(copied)[2]["picture"]).unlink()
    assert ran(copied).new_rows == 1
    assert len(rows_of(copied)) == 8


def test_more_seeds_and_methods_add_to_what_is_there(copied):
    again = ran(copied, seeds=3, methods=(Method("beam"), Method("point", 5)), counts=(1000,))
    assert again.new_rows == 1 + 3
    assert len(again.rows) == 6 and len(rows_of(copied)) == 8 + 4


def test_another_reference_changes_errors_but_runs_nothing_again(copied):
    before = {(row["method"], row["photons"], row["seed"]): row for row in rows_of(copied)}
    again = ran(copied, reference_photons=40_000)
    assert again.new_rows == 0
    for row in rows_of(copied):
        old = before[row["method"], row["photons"], row["seed"]]
        assert row["total_s"] == old["total_s"] and row["finished"] == old["finished"]
        assert row["reference"] != old["reference"] and row["relmse"] != old["relmse"]


def test_an_interrupted_report_goes_on(tmp_path, monkeypatch, first):
    append, count = RowFile.append, iter(range(100))

    def append_few(self, row):
        if next(count) == 3:
            raise KeyboardInterrupt
        append(self, row)

    monkeypatch.setattr(RowFile, "append", append_few)
    with pytest.raises(Interrupted, match="3 finished runs are kept"):
        ran(tmp_path)
    assert len(rows_of(tmp_path)) == 3
    monkeypatch.setattr(RowFile, "append", append)
    assert ran(tmp_path).new_rows == 5
    assert list(map(errors_of, rows_of(tmp_path)))[:3] == list(map(errors_of, rows_of(first[0])))[:3]


def test_a_budget_leaves_out_the_largest_and_says_so(tmp_path):
    tight = study(target_seconds=1e-3, counts=(100, 10**9), seeds=1, reference_photons=None)
    found = error_runs.StudyRun(tight, tmp_path, progress=False).run()
    assert {row.photons for row in found.rows} <= {100}
    assert any("1e9 photons" in line for line in error_runs.left_out_lines(found.left_out))
    assert "1e9 photons" in report_page(tight, found, gather_findings(tight, found, tmp_path), "")


def test_what_was_run_before_tells_the_pace(copied):
    again = ran(copied, counts=(1000, 4000, 10**9), target_seconds=60.0, reference_photons=20_000)
    assert again.new_rows == 0 and {task.photons for task in again.left_out} == {10**9}


def test_what_a_killed_report_left_is_swept(copied):
    (copied / "report" / "pictures" / ".beam.99999999.part.exr").write_bytes(b"half")
    left = copied / "report" / "work" / "other" / "passing" / "1000_1" / "photons.npz"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"half")
    assert ran(copied).new_rows == 0
    assert not list(copied.rglob("*.part*")) and not left.exists()


class Page(HTMLParser):
    """Collects what a page names and whether its tags close."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.sources, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_page_is_whole_self_contained_and_escaped(first):
    text = (first[0] / "report" / "index.html").read_text(encoding="utf-8")
    page = Page()
    page.feed(text)
    assert page.open == [] and not {"script", "link", "iframe"} & set(page.tags)
    assert page.sources and all(source.startswith("data:image/") for source in page.sources)
    assert "url(" not in text and "@import" not in text
    shown = "".join(page.text)
    assert NAME in shown and "skinrender report <slab>" in shown
    assert "two Intel Xeon X5550" in shown and "6274" in shown and "1740" in shown


def test_the_table_and_plots_are_there(first):
    out = first[0]
    table = (out / "table1.md").read_text(encoding="utf-8")
    assert "| estimate |" in table and "| 11754 | 1740 | 6.76 |" in table and "<script>" not in table
    plots = [
        out / "error_vs_time",
        *(out / "report/plots" / name for name in ("color_difference", "stages", "pictures_1")),
    ]
    for plot in plots:
        assert (
            plot.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
            and b"<svg" in plot.with_suffix(".svg").read_bytes()
        )


def test_the_page_of_extreme_cases_beside_it_is_linked(first, tmp_path):
    copied = tmp_path / "report"
    shutil.copytree(first[0], copied)
    assert "check.html" not in (copied / "report/index.html").read_text(encoding="utf-8")
    (copied / "check.html").touch()
    report(study(), copied, progress=False)
    assert '<a href="../check.html">' in (copied / "report/index.html").read_text(encoding="utf-8")


def test_errors_agree_with_what_theory_says(first):
    """On a uniform slab noise rules, so the error falls as 1 / photons, and the mean is right."""
    for series in first[1].findings[0].series:
        small, large = series.levels
        assert 2 < small.relmse.value / large.relmse.value < 8
        for level in series.levels:
            assert abs(level.bias.value) < 4 * level.bias.stderr
            assert abs(level.bias2.value) < 4 * level.bias2.stderr
            assert level.relmse.value == pytest.approx(
                level.noise2.value + level.bias2.value, abs=1e-9 + 0.5 * level.noise2.value
            )


def test_a_folder_with_a_foreign_table_is_refused(tmp_path):
    (tmp_path / "error_vs_time.csv").write_text("a,b\n")
    with pytest.raises(InputError, match="another folder"):
        ran(tmp_path)


# --- noise and bias of a series


def level(first, photons, noise2, bias2, stderr):
    """A level of synthetic errors, on rows of a true one."""
    real = first[1].findings[0].series[0].levels[0]
    relmse = noise2 + bias2
    seconds = 0.1 + 1e-5 * photons
    rows = tuple(
        replace(row, photons=photons, photons_stored=photons, total_s=seconds, relmse=relmse * factor)
        for row, factor in zip(real.rows, (0.95, 1.05))
    )
    return Level(
        rows, Uncertain(relmse, 0.1 * relmse), Uncertain(noise2, 0.1 * noise2), Uncertain(bias2, stderr), UNKNOWN, 0.1,
        0.1
    )


COUNTS = (10**4, 10**5, 10**6, 10**7)


def test_where_noise_ends_and_bias_begins(first):
    levels = [level(first, n, 100 / n, 4e-4, 10 / n) for n in COUNTS]
    series = make_series(Method("beam"), levels)
    assert series.floor_is_seen and series.floor.value == pytest.approx(4e-4)
    assert series.photons_at_floor == pytest.approx(250_000)
    assert 1.1 < series.seconds_at_floor < 10.1
    assert series.by_photons.slope == pytest.approx(-1, abs=0.1), "the floor bends the line"
    assert "bias of 2 % (rms" in series.verdict() and "rules beyond about 2.5e5 photons" in series.verdict()


def test_a_bias_that_is_not_seen_is_not_claimed(first):
    series = make_series(Method("beam"), [level(first, n, 100 / n, -1e-6, 10 / n) for n in COUNTS])
    assert not series.floor_is_seen and math.isnan(series.photons_at_floor)
    assert series.verdict().startswith("no bias seen")


def test_bias_seen_before_it_rules(first):
    series = make_series(Method("beam"), [level(first, n, 100 / n, 1e-6, 1 / n) for n in COUNTS])
    assert "noise still rules, up to about 1e8 photons" in series.verdict()
    assert series.seconds_at_floor == pytest.approx(10 * (0.1 + 1e-5 * 1e7), rel=0.01)


def test_one_seed_cannot_tell(first):
    alone = [replace(level(first, n, 100 / n, 0.0, 1.0), noise2=UNKNOWN, bias2=UNKNOWN) for n in COUNTS]
    assert "two seeds or more" in make_series(Method("beam"), alone).verdict()


def test_a_reference_by_the_same_estimate_shows_no_bias(first):
    series = make_series(Method("beam"), [level(first, n, 100 / n, 4e-4, 10 / n) for n in COUNTS], is_alike=True)
    assert not series.floor_is_seen and "cannot show" in series.verdict()


def test_two_standard_errors_are_not_yet_a_bias(first):
    series = make_series(Method("beam"), [level(first, n, 100 / n, 25 / n, 10 / n) for n in COUNTS])
    assert series.floor.interval[0] > 0 and not series.floor_is_seen
