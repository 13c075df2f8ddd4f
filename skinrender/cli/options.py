"""Arguments and options that several commands share."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console

if TYPE_CHECKING:
    from skinrender.scene.overrides import Override


class Count(click.ParamType):
    """A whole number from 1 on, which may be written 1e7."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            number = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if not (1 <= number <= 1e14 and number.is_integer()):
            self.fail(f"{value} is not a whole number from 1 to 1e14", param, ctx)
        return int(number)


class Quantity(click.FloatRange):
    """A finite number within bounds, which not a number always is for click."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number", param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return super().convert(number, param, ctx)


class Shard(click.ParamType):
    """i/n: the i-th of n parts, counted from 0."""

    name = "i/n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        index, _, count = value.partition("/")
        if not (index.isdecimal() and count.isdecimal() and int(index) < int(count)):
            self.fail(f"{value!r} is not i/n with 0 <= i < n, for example 0/4 to 3/4", param, ctx)
        return int(index), int(count)


def reporting(function: Callable) -> Callable:
    """Add -q, -v and --json; the command receives them as a `Console` named ``console``."""

    @click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors, warnings and --json.")
    @click.option("-v", "--verbose", is_flag=True, help="Say what each step decides.")
    @click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object on stdout.")
    @functools.wraps(function)
    def command(*args: Any, quiet: bool, verbose: bool, as_json: bool, **kwargs: Any) -> Any:
        if quiet and verbose:
            raise click.UsageError("-q and -v exclude each other.")
        return function(*args, console=Console(quiet, verbose, as_json), **kwargs)

    return command


def on_scene(function: Callable) -> Callable:
    """Add SCENE, --set and -o; the command receives ``scene_path``, ``overrides`` and ``output``."""
    return click.argument("scene_path", metavar="SCENE", type=click.Path(path_type=Path))(_on_scenes(function))


def on_scenes(function: Callable) -> Callable:
    """Add SCENE..., --set and -o; the command receives ``scene_paths``, ``overrides`` and ``output``."""
    scenes = click.argument(
        "scene_paths", metavar="SCENE...", nargs=-1, required=True, type=click.Path(path_type=Path)
    )
    return scenes(_on_scenes(function))


def _on_scenes(function: Callable) -> Callable:
    for decorate in (
        click.option(
            "-o", "--output", type=click.Path(path_type=Path), metavar="DIR",
            help="Folder to write to.  [default: out/<scene name>]",
        ),
        click.option(
            "--set", "overrides", multiple=True, metavar="KEY.PATH=VALUE",
            help="Set a value of the scene, e.g. lesions.0.melanin_scale=0.1; may be repeated.",
        ),
    ):  # fmt: skip
        function = decorate(function)
    return function


def tracing(function: Callable) -> Callable:
    """Add --photons, --seed and --resume."""
    for decorate in (
        click.option("--resume", is_flag=True, help="Go on from the rounds that an interrupted run has left."),
        click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the photons.  [default: the scene's]"),
        click.option("--photons", type=Count(), help="Photons to store, e.g. 1e7.  [default: the scene's]"),
    ):
        function = decorate(function)
    return function


def estimating(function: Callable) -> Callable:
    """Add --method, --gather-count and --reflectance."""
    for decorate in (
        click.option("--reflectance", is_flag=True, help="Also write the radiance factor, as T. channels of the EXR."),
        click.option(
            "--gather-count", type=Count(), metavar="K",
            help="Photons that a beam or sample point meets on average.  [default: the scene's]",
        ),
        click.option(
            "--method", type=click.Choice(["beam", "point", "reference"]), help="Radiance estimate.  [default: the scene's]"
        ),
    ):  # fmt: skip
        function = decorate(function)
    return function


def with_workers(function: Callable) -> Callable:
    """Add --workers."""
    return click.option(
        "--workers", type=click.IntRange(min=1), help="Processes or threads.  [default: what the run is worth]"
    )(function)


def on_cluster(function: Callable) -> Callable:
    """Add --scheduler."""
    return click.option(
        "--scheduler", metavar="ADDRESS",
        help="Have a dask cluster do the work, e.g. tcp://10.0.0.5:8786 (extra `cluster`).",
    )(function)  # fmt: skip


def as_overrides(
    *, photons: int | None = None, seed: int | None = None, method: str | None = None, gather_count: int | None = None
) -> tuple[Override, ...]:
    """Options that stand for scene values, as overrides; they come after, and so win over, those of --set."""
    from skinrender.scene.overrides import Override

    values = {
        "--photons": ("photons.stored", photons),
        "--seed": ("photons.seed", seed),
        "--method": ("estimate.method", method),
        "--gather-count": ("estimate.gather_count", gather_count),
    }
    return tuple(
        Override(f"{key}={value}", f"{option} {value}") for option, (key, value) in values.items() if value is not None
    )
