"""Stages add up, and the table of them grows by rows."""

from __future__ import annotations

import csv
import time

import pytest

from skinrender.engine.clock import StageClock, append_timing


def test_stages_add_up_to_the_total():
    clock = StageClock()
    for stage in ("load", "trace", "load"):
        with clock.stage(stage):
            time.sleep(0.01)
    seconds = clock.seconds
    assert list(seconds) == ["load", "trace", "total"]
    assert seconds["load"] >= 0.02 and seconds["trace"] >= 0.01
    assert seconds["total"] == pytest.approx(seconds["load"] + seconds["trace"])


def test_a_failing_stage_is_timed_too():
    clock = StageClock()
    with pytest.raises(ValueError), clock.stage("trace"):
        raise ValueError
    assert "trace" in clock.seconds


def test_rows_are_added_under_one_head(tmp_path):
    path = tmp_path / "timing.csv"
    for command in ("trace", "render"):
        append_timing(path, {"trace": 1.5, "total": 1.5}, command=command, workers=2)
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["command"], row["stage"], float(row["seconds"])) for row in rows] == [
        ("trace", "trace", 1.5), ("trace", "total", 1.5), ("render", "trace", 1.5), ("render", "total", 1.5),
    ]  # fmt: skip
    assert all(row["host"] and row["workers"] == "2" and row["python"] for row in rows)
