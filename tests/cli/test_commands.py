"""What every command keeps to: help with an example, codes, nothing but JSON on stdout."""

from __future__ import annotations

import json
import re

import pytest
from command_line import call, summary_of

from skinrender.cli import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_has_an_example_of_the_command(command, option):
    result = call(command, option)
    assert result.exit_code == 0
    assert re.search(rf"Example:\n +skinrender {command}\b", result.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_explained(command):
    for parameter in main.commands[command].params:
        if parameter.param_type_name == "option":
            assert parameter.help, parameter.name


def test_examples_in_help_name_shipped_scenes(repository):
    for command in main.commands.values():
        for scene in re.findall(r"configs/\S+\.yaml", command.help):
            assert (repository / scene).is_file()


def test_commands_are_listed_in_the_order_of_their_use():
    listed = re.findall(r"^  (\w+)  ", call("--help").stdout.partition("Commands:")[2], flags=re.MULTILINE)
    assert tuple(listed) == COMMANDS


def test_version_names_what_computes():
    text = call("--version").stdout
    assert re.search(r"skinrender .+\nnumba \d.+\nnumpy \d.+\npython \d.+\nCPU .+ cores\n", text)


def test_schema_describes_the_scene():
    schema = summary_of(call("schema"))
    assert {"patch", "skin", "photons"} <= schema["properties"].keys()


@pytest.mark.parametrize("arguments", [["--nonsense"], ["build"], ["bild", "x.yaml"], ["schema", "-q", "-v"]])
def test_bad_use_is_2(arguments):
    result = call(*arguments)
    assert result.exit_code == 2
    assert "Usage:" in result.stderr and result.stdout == ""


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--photons", "many", "'many' is not a number"),
        ("--photons", "0.5", "0.5 is not a whole number"),
        ("--photons", "nan", "nan is not a whole number"),
        ("--shard", "4/4", "0 <= i < n"),
        ("--shard", "1", "0 <= i < n"),
        ("--workers", "0", "0 is not in the range"),
        ("--seed", "-1", "-1 is not in the range"),
    ],
)
def test_bad_option_values_are_2_and_told(slab, option, value, told):
    result = call("trace", slab, option, value)
    assert result.exit_code == 2
    assert told in result.stderr


@pytest.mark.parametrize("value", ["nan", "inf"])
@pytest.mark.parametrize(("command", "option"), [
    ("render", "--time"), ("render", "--target-error"), ("report", "--target-seconds"), ("spectrum", "--stderr"),
    ("export", "--voxel-um"),
])  # fmt: skip
def test_numbers_that_are_not_finite_are_2(slab, command, option, value):
    result = call(command, slab, option, value)
    assert result.exit_code == 2
    assert f"{value} is not a finite number" in result.stderr


def test_mistakes_in_a_scene_are_2_with_file_line_and_column(slab, tmp_path):
    slab.write_text(slab.read_text().replace("light:", "ligth:"))
    result = call("build", slab, "-o", tmp_path / "out", "--json")
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{slab}:6:1" in result.stderr and "light" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_missing_scene_is_2(tmp_path):
    result = call("render", tmp_path / "none.yaml")
    assert result.exit_code == 2
    assert "no such scene file" in result.stderr


@pytest.mark.parametrize(
    "override", ["photons.stord=1", "photons", "lesions.7.melanin_scale=1", "patch.columns=[0, 1]"]
)
def test_a_bad_override_is_2_and_named(slab, tmp_path, override):
    result = call("build", slab, "--set", override, "-o", tmp_path)
    assert result.exit_code == 2
    assert f"--set {override}" in result.stderr


@pytest.mark.parametrize(("command", "option"), [("trace", "--photons"), ("estimate", "--gather-count")])
def test_a_value_that_the_scene_refuses_is_told_by_its_option(slab, tmp_path, command, option):
    result = call(command, slab, option, "1e14", "-o", tmp_path / "o")
    assert result.exit_code == 2 and f"error: {option} 100000000000000: " in result.stderr and "--set" not in result.stderr


def test_output_that_is_a_file_is_2(slab):
    result = call("build", slab, "-o", slab)
    assert result.exit_code == 2
    assert "is not a folder" in result.stderr


def test_output_of_an_impossible_name_is_2(slab, tmp_path):
    result = call("build", slab, "-o", tmp_path / ("x" * 300))
    assert result.exit_code == 2
    assert "cannot be made: File name too long" in result.stderr


def test_default_folder_is_named_by_the_scene(slab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    summary = summary_of(call("build", slab, "--json"))
    assert (tmp_path / "out" / "slab" / "volume.npz").is_file()
    assert summary["files"] == ["out/slab/volume.npz", "out/slab/section.png"]


def test_quiet_says_nothing(slab, tmp_path):
    result = call("build", slab, "-o", tmp_path, "-q")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


def test_values_that_are_not_finite_become_null(capsys):
    from skinrender.cli.console import Console

    Console(as_json=True).result({"a": [float("nan")], "b": {"c": float("inf")}, "d": 1.5}, [])
    assert json.loads(capsys.readouterr().out) == {"a": [None], "b": {"c": None}, "d": 1.5}


@pytest.mark.parametrize(
    ("value", "stderr", "text"),
    [
        (0.123456, 0.00123, "0.1235 ± 0.0012"),
        (12.3, 4.0, "12.3 ± 4.0"),
        (1.0, None, "1"),
        (1e-12, 1e-14, "1e-12 ± 1e-14"),
    ],
)
def test_values_are_rounded_to_their_error(value, stderr, text):
    from skinrender.cli.console import with_error

    assert with_error({"value": value, "stderr": stderr}) == text


def test_plan_writes_nothing_and_tells_all(slab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    summary = summary_of(call("plan", slab, "--json"))
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert {"features", "photons_emitted", "photons_stored", "bytes", "seconds", "rounds"} <= summary.keys()
    assert all(row.keys() == {"feature", "used", "reason"} and row["reason"] for row in summary["features"])
    assert {"disk_free", "memory_free"} <= summary["bytes"].keys()


def test_plan_warns_of_a_disk_too_small(slab):
    result = call("plan", slab, "--photons", "1e13")
    assert result.exit_code == 0
    assert "warning: disk: " in result.stderr and "are free" in result.stderr


def test_plan_of_a_volume_larger_than_memory_is_2(slab):
    result = call("plan", slab, "--set", "patch.columns=[5000,5000]", "--set", "slab.layers.0.voxel_layers=10000")
    assert result.exit_code == 2
    assert "takes 500.0 GB of memory" in result.stderr
