"""The stages end to end on a small scene, and what is done again when something changes."""

from __future__ import annotations

import csv
import hashlib
import shutil

import numpy as np
import pytest
from command_line import FEW_PHOTONS, SMALL, call, summary_of
from PIL import Image

from skinrender import read_exr


def files_of(folder) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def again(smoke_scene, folder, *options) -> dict:
    return summary_of(call("render", smoke_scene, *SMALL, *FEW_PHOTONS, "-o", folder, "--json", *options))


def test_render_writes_all_files_and_the_summary(first_render):
    folder, summary = first_render
    assert {path.name for path in folder.iterdir()} == {
        "volume.npz", "section.png", "photons.npz", "beam.exr", "beam.png", "timing.csv", "index.html"
    }  # fmt: skip
    assert summary["stages_run"] == ["build", "trace", "estimate"]
    assert summary["photons_stored"] >= 4000 and summary["lost"] == 0 and summary["nan_pixels"] == 0
    assert summary["mean_radiance"]["value"] > 0
    assert {"load", "trace", "estimate", "total"} <= summary["seconds"].keys()
    assert summary["seconds"]["total"] == pytest.approx(
        sum(value for stage, value in summary["seconds"].items() if stage != "total")
    )


def test_picture_has_the_mean_that_is_told(first_render):
    folder, summary = first_render
    image = read_exr(folder / "beam.exr")
    assert image.radiance.shape == (8, 8, 3)
    assert image.radiance.sum(axis=-1).mean() == pytest.approx(summary["mean_radiance"]["value"], rel=1e-5)


def test_light_is_conserved(first_render):
    summary = first_render[1]
    parts = [summary[name]["value"] for name in ("reflectance", "transmittance", "sides")]
    assert sum(parts) + sum(part["value"] for part in summary["absorbed"].values()) == pytest.approx(1, abs=1e-9)


def test_timing_has_the_rows_of_the_table(first_render):
    with open(first_render[0] / "timing.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {"load", "trace", "estimate", "total"} <= {row["stage"] for row in rows}
    assert {row["command"] for row in rows} == {"render"}


def test_rendering_again_does_nothing(rendered, smoke_scene, first_render):
    before = files_of(rendered)
    summary = again(smoke_scene, rendered)
    assert summary["stages_run"] == []
    assert files_of(rendered) == before
    for key in ("photons_stored", "hash", "clipped_fraction"):
        assert summary[key] == first_render[1][key]
    for key in ("mean_radiance", "reflectance"):  # the map holds power by photon: multiplied back, the last digit may differ
        assert summary[key] == pytest.approx(first_render[1][key], rel=1e-12)


@pytest.mark.parametrize(
    ("options", "stages"),
    [
        (["--set", "camera.cross_polarized=true"], ["estimate"]),
        (["--reflectance"], ["estimate"]),
        (["--method", "point"], ["estimate"]),
        (["--seed", "2"], ["trace", "estimate"]),
        (["--set", "light.height_mm=50"], ["trace", "estimate"]),
        (["--set", "lesions.0.melanin_scale=0.1"], ["build", "trace", "estimate"]),
    ],
)
def test_only_what_changed_is_done_again(rendered, smoke_scene, options, stages):
    assert again(smoke_scene, rendered, *options)["stages_run"] == stages


@pytest.mark.parametrize(
    ("name", "stages"),
    [("beam.png", ["estimate"]), ("photons.npz", ["trace"]), ("section.png", ["build"])],
)
def test_a_deleted_file_is_made_again_and_what_follows_stays(rendered, smoke_scene, name, stages):
    (rendered / name).unlink()
    assert again(smoke_scene, rendered)["stages_run"] == stages


@pytest.mark.parametrize("name", ["volume.npz", "photons.npz", "beam.exr"])
def test_a_truncated_file_is_made_again(rendered, smoke_scene, name):
    whole = (rendered / name).read_bytes()
    (rendered / name).write_bytes(whole[: len(whole) // 2])
    again(smoke_scene, rendered)
    assert (rendered / name).read_bytes() == whole


def test_the_three_commands_make_what_render_makes(first_render, smoke_scene, tmp_path):
    for command in (["build"], ["trace", *FEW_PHOTONS], ["estimate"]):
        summary_of(call(command[0], smoke_scene, *SMALL, *command[1:], "-o", tmp_path, "--json"))
    for name in ("volume.npz", "photons.npz"):
        assert (tmp_path / name).read_bytes() == (first_render[0] / name).read_bytes()
    assert np.array_equal(read_exr(tmp_path / "beam.exr").radiance, read_exr(first_render[0] / "beam.exr").radiance)


def test_human_summary_is_a_table(rendered, smoke_scene):
    result = call("estimate", smoke_scene, *SMALL, "-o", rendered)
    assert result.exit_code == 0
    assert "mean radiance" in result.stdout and "W mm^-2 sr^-1" in result.stdout


def test_reference_says_what_may_still_be_wrong(first_render, rendered, smoke_scene):
    call_for = ("estimate", smoke_scene, *SMALL, "-o", rendered, "--method", "reference")
    summary = summary_of(call(*call_for, "--json"))
    assert {"reference.exr", "reference.png"} <= {path.name for path in rendered.iterdir()}
    for part in summary["remaining_bias"].values():
        assert abs(part["value"]) < 0.2 and part["stderr"] >= 0
    beam = first_render[1]["mean_radiance"]
    assert summary["mean_radiance"]["value"] == pytest.approx(beam["value"], abs=6 * beam["stderr"])
    assert "light left out" in call(*call_for).stdout


def test_reflectance_adds_channels(rendered, smoke_scene):
    import OpenEXR

    summary_of(call("estimate", smoke_scene, *SMALL, "-o", rendered, "--reflectance", "--json"))
    with OpenEXR.File(str(rendered / "beam.exr"), separate_channels=True) as file:
        assert "T.550,000000nm" in file.channels()


def test_shards_merge_into_the_undivided_map(first_render, rendered, smoke_scene, tmp_path):
    parts = [tmp_path / "a", tmp_path / "b"]
    for index, part in enumerate(parts):
        part.mkdir()
        shutil.copy(rendered / "volume.npz", part)
        summary_of(call("trace", smoke_scene, *SMALL, *FEW_PHOTONS, "--shard", f"{index}/2", "-o", part, "--json"))
    merged = summary_of(call("merge", *parts, "-o", tmp_path / "whole", "--json"))
    assert merged["photons_stored"] == first_render[1]["photons_stored"]
    whole = tmp_path / "whole" / "photons.npz"
    assert whole.read_bytes() == (first_render[0] / "photons.npz").read_bytes()


@pytest.mark.parametrize(
    ("command", "name", "told"),
    [
        ("trace", "volume.npz", "there is no volume yet"),
        ("estimate", "volume.npz", "there is no volume yet"),
        ("estimate", "photons.npz", "there is no photon map yet"),
    ],
)
def test_a_missing_stage_is_named_with_the_remedy(rendered, smoke_scene, command, name, told):
    (rendered / name).unlink()
    result = call(command, smoke_scene, *SMALL, "-o", rendered)
    assert result.exit_code == 2
    assert told in result.stderr and "skinrender " in result.stderr


@pytest.mark.parametrize("command", ["trace", "estimate"])
def test_a_volume_of_another_scene_is_refused(rendered, smoke_scene, command):
    result = call(command, smoke_scene, *SMALL, "--set", "lesions.0.melanin_scale=0.1", "-o", rendered)
    assert result.exit_code == 2
    assert "another scene; it differs in: lesions" in result.stderr


def test_a_map_of_another_light_is_refused(rendered, smoke_scene):
    result = call("estimate", smoke_scene, *SMALL, "--set", "light.spectrum=A", "-o", rendered)
    assert result.exit_code == 2
    assert "another scene; it differs in: light" in result.stderr


def test_build_and_info_of_a_tattoo(tmp_path, slab):
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "dot.png")
    lesion = "{kind: tattoo, pattern: dot.png, ink: green, volume_fraction: 0.01, depth_mm: [0.2, 0.5]}"
    scene = tmp_path / "tattoo.yaml"
    scene.write_text(f"patch: {{size_mm: [1, 1], columns: [2, 1]}}\nbands_nm: [550]\nskin: {{}}\nlesions: [{lesion}]\n")
    assert call("build", scene, "-o", tmp_path, "-q").exit_code == 0 and (tmp_path / "section.png").is_file()
    ink = summary_of(call("info", tmp_path / "volume.npz", "--json"))["ink"]
    assert ink["green"]["max"] == pytest.approx(0.01) and ink["green"]["min"] == 0
    assert "green: 0 to 0.01" in call("info", tmp_path / "volume.npz").stdout
    assert call("build", slab, "-o", tmp_path, "-q").exit_code == 0
    assert "ink" not in summary_of(call("info", tmp_path / "volume.npz", "--json"))


def test_compare_a_picture_with_itself(first_render, tmp_path):
    picture = first_render[0] / "beam.exr"
    mask = np.zeros((8, 8), np.uint8)
    mask[2:4, 2:4] = 255
    Image.fromarray(mask).save(tmp_path / "lesion.png")
    summary = summary_of(call("compare", picture, picture, "--mask", tmp_path / "lesion.png", "--json"))
    assert summary["rmse"] == 0 and summary["regions"]["lesion"]["delta_e_mean"] == 0
    assert "within lesion" in call("compare", picture, picture, "--mask", tmp_path / "lesion.png").stdout


def test_compare_selects_the_white_pixels(first_render, tmp_path):
    """A picture of red, green, blue only differs in one pixel, which only the mask that holds it sees."""
    import OpenEXR

    values = np.full((8, 8), 0.5, np.float32)
    changed = values.copy()
    changed[1, 6] = 1.0
    for name, channel in (("a", changed), ("b", values)):
        with OpenEXR.File({"type": OpenEXR.scanlineimage}, dict.fromkeys("RGB", channel)) as file:
            file.write(str(tmp_path / f"{name}.exr"))
    for name, pixel in (("in", (1, 6)), ("out", (6, 1))):
        mask = np.zeros((8, 8), np.uint8)
        mask[pixel] = 255
        Image.fromarray(mask).save(tmp_path / f"{name}.png")
    masks = ["--mask", tmp_path / "in.png", "--mask", tmp_path / "out.png"]
    regions = summary_of(call("compare", tmp_path / "a.exr", tmp_path / "b.exr", *masks, "--json"))["regions"]
    assert regions["in"]["rmse"] == pytest.approx(0.5, abs=1e-6)
    assert regions["out"]["rmse"] == 0


def test_compare_with_a_mask_of_another_size_is_2(first_render, tmp_path):
    Image.new("L", (9, 8), 255).save(tmp_path / "mask.png")
    picture = first_render[0] / "beam.exr"
    result = call("compare", picture, picture, "--mask", tmp_path / "mask.png")
    assert result.exit_code == 2
    assert "9 x 8" in result.stderr


@pytest.mark.parametrize("command", ["trace", "render"])
def test_a_scheduler_that_is_none_is_refused_before_anything_is_walked(slab, tmp_path, command):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    call("build", slab, "-o", tmp_path)
    result = call(command, slab, "-o", tmp_path, "--scheduler", "nowhere")
    assert result.exit_code == 2
    assert "--scheduler: nowhere cannot be reached" in result.stderr
    assert not (tmp_path / "rounds").exists()
