"""`render --target-error` and `--time`: no map, the picture so far, and what was reached is told."""

from __future__ import annotations

import time

import pytest
from command_line import SMALL, call, summary_of

from skinrender import read_exr
from skinrender.engine.lock import folder_lock


@pytest.fixture(autouse=True)
def small_rounds(monkeypatch):
    monkeypatch.setattr("skinrender.engine.progressive.ROUND_STORED", 500)


def test_picture_of_the_noise_asked_for(smoke_scene, tmp_path):
    summary = summary_of(call("render", smoke_scene, *SMALL, "-o", tmp_path / "out", "--json", "--target-error", "0.2"))
    assert 0.0 < summary["stderr_relative_mean"] <= 0.2
    assert summary["stages_run"] == ["build", "trace", "estimate"]
    assert summary["lost"] == 0 and summary["photons_stored"] > 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"volume.npz", "section.png", "beam.exr", "beam.png", "timing.csv", "index.html"}
    image = read_exr(tmp_path / "out" / "beam.exr")
    assert image.provenance["photon_map"]["rounds"] == summary["rounds"]


def test_picture_in_a_time(smoke_scene, tmp_path):
    """The first part comes whatever the time; more only while there is time for it."""
    began = time.monotonic()
    summary = summary_of(call("render", smoke_scene, *SMALL, "-o", tmp_path / "out", "--json", "--time", "0.1"))
    assert summary["rounds"] == 20
    spent = time.monotonic() - began
    longer = summary_of(call("render", smoke_scene, *SMALL, "-o", tmp_path / "out", "--json", "--time", str(spent + 2.0)))
    assert longer["rounds"] > 20
    assert longer["stages_run"] == ["trace", "estimate"]


def test_section_is_that_of_the_volume(smoke_scene, tmp_path):
    """Drawn once, and again when the volume is another."""
    drawn = []
    for option in ((), (), ("--set", "skin.layers.basal.thickness_um=20")):
        summary_of(call("render", smoke_scene, *SMALL, "-o", tmp_path, "--json", "--target-error", "1", *option))
        drawn.append((tmp_path / "section.png").stat().st_mtime_ns)
    assert drawn[0] == drawn[1] < drawn[2]


def test_folder_of_another_run_is_left_alone(smoke_scene, tmp_path):
    with folder_lock(tmp_path):
        result = call("render", smoke_scene, *SMALL, "-o", tmp_path, "--target-error", "0.5")
        assert result.exit_code == 2
        assert "another run" in result.output
        assert [path.name for path in tmp_path.iterdir()] == [".skinrender.lock"]


@pytest.mark.parametrize("option", [("--photons", "1e4"), ("--resume",), ("--scheduler", "tcp://localhost:1")])
def test_options_of_a_fixed_number_of_photons_are_refused(smoke_scene, tmp_path, option):
    result = call("render", smoke_scene, "-o", tmp_path / "out", "--target-error", "0.1", *option)
    assert result.exit_code == 2
    assert "--target-error" in result.output
    assert not (tmp_path / "out").exists()


def test_gather_count_is_refused(smoke_scene, tmp_path):
    result = call("render", smoke_scene, *SMALL, "-o", tmp_path / "out", "--time", "5", "--gather-count", "100")
    assert result.exit_code == 2
    assert "estimate.gather_count" in result.output
