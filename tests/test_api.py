"""The Python API: every name is there, typed and described, and stays there after the packages are imported."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import skinrender

FUNCTIONS = [name for name in skinrender.__all__ if inspect.isfunction(getattr(skinrender, name))]
DESCRIBED = [name for name in skinrender.__all__ if dataclasses.is_dataclass(getattr(skinrender, name))]


@pytest.mark.parametrize("name", skinrender.__all__)
def test_name_is_a_function_or_a_class(name):
    for package in ("estimate", "film", "optics"):
        importlib.import_module(f"skinrender.{package}")
    assert callable(getattr(skinrender, name))


def test_the_stub_says_where_each_name_is_at_home():
    stub = ast.parse(Path(skinrender.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    told = {
        alias.asname or alias.name: getattr(importlib.import_module(node.module), alias.name)
        for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }  # fmt: skip
    (listed,) = (ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert listed == skinrender.__all__
    assert told == {name: getattr(skinrender, name) for name in skinrender.__all__}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_parameters_are_typed_and_described_and_errors_told(name):
    function = getattr(skinrender, name)
    told = inspect.getdoc(function)
    hints = inspect.get_annotations(function)
    assert "return" in hints and "Any" not in (hints["return"], hints.get("scene"))
    head, _, described = told.partition("Parameters\n----------\n")
    assert head.strip() and "Raises\n------\n" in described
    for parameter in inspect.signature(function).parameters:
        assert parameter in hints
        assert any(parameter in line.partition(" : ")[0].split(", ") for line in described.splitlines()), parameter


@pytest.mark.parametrize("name", DESCRIBED)
def test_fields_of_what_comes_out_are_described(name):
    described = inspect.getdoc(getattr(skinrender, name))
    for field in dataclasses.fields(getattr(skinrender, name)):
        assert field.name in described, field.name


def test_estimate_is_the_function_and_its_package_can_be_imported():
    program = (
        "import skinrender; first = skinrender.estimate\n"
        "from skinrender.estimate import radius\n"
        "from skinrender.estimate.beam import estimate_beam\n"
        "from skinrender import estimate\n"
        "assert skinrender.estimate is first is estimate and callable(first) and radius.WIDEST_MM > 0"
    )
    subprocess.run([sys.executable, "-W", "error::ImportWarning", "-c", program], check=True)


def test_unknown_name_is_told():
    with pytest.raises(AttributeError, match="no attribute 'render_all'"):
        _ = skinrender.render_all
