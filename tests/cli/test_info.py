"""`info` tells what each file is, in one screen."""

from __future__ import annotations

import math

import pytest
from command_line import FEW_PHOTONS, SMALL, call, summary_of

SCREEN = (24, 80)


@pytest.fixture(scope="session")
def folder(first_render, smoke_scene, tmp_path_factory):
    """The small render with everything that can lie beside it; not to be changed."""
    folder = tmp_path_factory.mktemp("all")
    for path in first_render[0].iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    for program in ("nrrd", "tiff"):
        assert call("export", smoke_scene, *SMALL, "--to", program, "-o", folder, "-q").exit_code == 0
    shard = call("trace", smoke_scene, *SMALL, *FEW_PHOTONS, "--shard", "0/20", "-o", folder, "-q")
    assert shard.exit_code == 0
    return folder


def lines_on_screen(text: str) -> int:
    """How many lines a text takes on a terminal."""
    return sum(max(1, math.ceil(len(line) / SCREEN[1])) for line in text.splitlines())


@pytest.mark.parametrize(("name", "kind", "told"), [
    ("volume.npz", "volume", "450 to 650"),
    ("photons.npz", "photon map", "450 to 650"),
    ("beam.exr", "spectral picture", "S0.450,000000nm ... (3)"),
    ("rounds/round-000000.npz", "round of an unfinished photon pass, or of a shard", "index"),
    ("rounds/run.npz", "what the rounds beside it have in common", "450 to 650"),
    ("layers.seg.nrrd", "NRRD volume for other programs", "[stratum_corneum, "),
    ("melanin.nrrd", "NRRD volume for other programs", "melanin fraction of the volume"),
    ("beam.tif", "spectral stack for ImageJ", "[450 nm, ..., 650 nm]"),
])  # fmt: skip
def test_kind_content_and_provenance_in_one_screen(folder, name, kind, told):
    summary = summary_of(call("info", folder / name, "--json"))
    assert summary["kind"] == kind and summary["provenance"] and summary["bytes"] > 0
    text = call("info", folder / name).stdout
    assert told in text and "\nprovenance" in text
    assert lines_on_screen(text.replace(str(folder), "out/smoke_beam")) <= SCREEN[0]


def test_verbose_tells_the_whole_provenance(folder):
    assert "melanin_scale" not in call("info", folder / "volume.npz").stdout
    assert "melanin_scale" in call("info", folder / "volume.npz", "-v").stdout


def test_same_provenance_in_the_volume_and_its_exports(folder):
    known = [summary_of(call("info", folder / name, "--json"))["provenance"] for name in ("volume.npz", "melanin.nrrd")]
    assert known[0] == known[1]
    picture, stack = (summary_of(call("info", folder / name, "--json")) for name in ("beam.exr", "beam.tif"))
    assert stack["provenance"] == picture["provenance"]
    assert stack["values"]["max"] == pytest.approx(1e6 * picture["radiance_W_per_mm2_sr"]["max"], rel=1e-6)


def test_table(folder):
    summary = summary_of(call("info", folder / "timing.csv", "--json"))
    assert summary["kind"] == "table" and summary["rows"] > 3
    assert summary["columns"]["seconds"]["min"] >= 0
    assert "render" in summary["columns"]["command"]
    assert lines_on_screen(call("info", folder / "timing.csv").stdout) <= SCREEN[0]


@pytest.mark.parametrize("name", ["beam.png", "none.npz", "."])
def test_anything_else_is_2(first_render, name):
    assert call("info", first_render[0] / name).exit_code == 2


@pytest.mark.parametrize("name", ["melanin.nrrd", "beam.tif", "timing.csv", "rounds/round-000000.npz"])
@pytest.mark.parametrize("length", [0, 5, 60, 300])
def test_cut_off_is_told_or_read(folder, tmp_path, name, length):
    part = tmp_path / name.rpartition("/")[2]
    part.write_bytes((folder / name).read_bytes()[:length])
    result = call("info", part)
    assert result.exit_code in ((0, 2) if name == "timing.csv" else (2,)), result.stdout
    assert result.exit_code == 0 or result.stderr.startswith(f"error: {part}")
