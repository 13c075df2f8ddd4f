"""The Python API: every name is there, and stays there after the packages are imported."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import skinrender


@pytest.mark.parametrize("name", skinrender.__all__)
def test_name_is_a_function_or_an_error(name):
    for package in ("estimate", "film", "optics"):
        importlib.import_module(f"skinrender.{package}")
    assert callable(getattr(skinrender, name))


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
