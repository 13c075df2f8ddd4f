"""The command export: its files, its notes, and what it refuses."""

from __future__ import annotations

import pytest
from command_line import call, summary_of


@pytest.mark.parametrize(("program", "names"), [
    ("nrrd", ["layers.seg.nrrd", "melanin.nrrd"]),
    ("mcx", ["slab_550nm.json"]),
    ("mitsuba", ["slab_550nm.xml"]),
])  # fmt: skip
def test_writes_the_other_programs_files(slab, tmp_path, program, names):
    lit = ("--set", "light={kind: sky}")
    summary = summary_of(call("export", slab, *lit, "--to", program, "-o", tmp_path / "out", "--json"))
    assert [path.rsplit("/", 1)[1] for path in summary["files"]] == names
    assert all((tmp_path / "out" / name).stat().st_size for name in names)
    assert summary["program"] == program


def test_writes_the_picture_as_tiff(rendered, smoke_scene):
    summary = summary_of(call("export", smoke_scene, "--to", "tiff", "-o", rendered, "--json",
                              "--set", "camera.pixels=[8, 8]", "--set", "bands_nm=[450, 550, 650]"))  # fmt: skip
    assert summary["pages"] == 3
    assert (rendered / "beam.tif").is_file()


@pytest.mark.parametrize(("options", "told"), [
    (("--to", "blender"), "'blender' is not one of"),
    ((), "--to"),
    (("--to", "tiff"), "there is no picture yet"),
    (("--to", "mcx", "--band", "600"), "no band at 600 nm"),
    (("--to", "mcx", "--band", "nan"), "nan is not a finite number"),
    (("--to", "mcx", "--voxel-um", "0.001"), "a grid of 1e+06 x 1e+06 x 1e+06 voxels takes"),
    (("--to", "nrrd", "--band", "550"), "--band is not for nrrd"),
    (("--to", "mitsuba", "--voxel-um", "5"), "it is for --to mcx"),
    (("--to", "mitsuba"), "cannot find parallel light"),
])  # fmt: skip
def test_mistakes_are_told(slab, tmp_path, options, told):
    result = call("export", slab, *options, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert told in result.stderr
