"""The table of runs survives what kills its writer."""

from __future__ import annotations

import csv
from dataclasses import replace

import pytest

from skinrender.analysis.error_rows import COLUMNS, ErrorRow, RowFile
from skinrender.errors import InputError


def row(seed, **changes):
    numbers = dict.fromkeys([name for name in COLUMNS if ErrorRow.__annotations__[name] == "float"], 0.5)
    made = ErrorRow(
        scene='a, "b" <c>', scene_hash="5e1f", method="beam", gather_count=0, photons=1000, seed=seed, program="9a",
        workers=1, photons_stored=1007, photons_emitted=180, reference="r_1", picture="report/p.exr", finished="now", **numbers,
    )  # fmt: skip
    return replace(made, **changes)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "error_vs_time.csv"


def written(path, count=3):
    file = RowFile(path)
    for seed in range(count):
        file.append(row(seed, relmse=-1e-5))
    return file.rows


def test_rows_are_read_as_they_were_written(path):
    rows = written(path)
    assert RowFile(path).rows == rows
    with open(path, newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [line["seed"] for line in table] == ["0", "1", "2"]
    assert {name for name in COLUMNS if name.endswith("_s")} >= {"load_s", "trace_s", "estimate_s", "write_s", "total_s"}


def test_undefined_is_an_empty_cell(path):
    RowFile(path).append(row(1, ssim=float("nan"), efficiency_per_s=float("inf")))
    found = RowFile(path).rows[0]
    assert found.ssim != found.ssim and found.efficiency_per_s != found.efficiency_per_s


@pytest.mark.parametrize("cut", [1, 7, 60])
def test_a_last_line_cut_off_is_dropped_and_the_rest_kept(path, cut):
    rows = written(path)
    path.write_bytes(path.read_bytes()[:-cut])
    file = RowFile(path)
    assert file.rows == rows[:-1]
    file.append(row(9))
    assert [found.seed for found in RowFile(path).rows] == [0, 1, 9]


def test_a_header_cut_off_is_an_empty_table(path):
    written(path)
    path.write_bytes(path.read_bytes()[:20])
    assert RowFile(path).rows == []


def test_foreign_or_damaged_tables_are_refused_with_the_line(path):
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="csv:1: is not a table"):
        RowFile(path)
    path.unlink()
    written(path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(",1007,", ",many,", 1), encoding="utf-8")
    with pytest.raises(InputError, match="csv:2"):
        RowFile(path)
    path.write_bytes(b"\xff\xfe\n")
    with pytest.raises(InputError, match="csv:1"):
        RowFile(path)
