"""Calling the command line in tests."""

from __future__ import annotations

import json

from click.testing import CliRunner, Result

from skinrender.cli import main

SMALL = ("--set", "camera.pixels=[8, 8]", "--set", "bands_nm=[450, 550, 650]")
FEW_PHOTONS = ("--photons", "4e3")


def call(*arguments: object) -> Result:
    """Run a command; its ``stdout`` and ``stderr`` are apart."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def summary_of(result: Result) -> dict:
    """The JSON object that a command printed, which must be all of its stdout."""
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)
