"""`key.path=value`: single values given on the command line, by --set or an option, in place of the scene file's."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from skinrender.errors import InputError
from skinrender.scene.problems import Mark, told
from skinrender.scene.yaml_source import Source, parse_source


@dataclass(frozen=True)
class Override:
    """A value in place of the scene file's.

    Parameters
    ----------
    text : `key.path=value`.
    option : what the user wrote, as messages tell it, e.g. `--photons 1e6`.
    """

    text: str
    option: str


def apply_overrides(source: Source, overrides: Iterable[str | Override]) -> None:
    """Put each override into the source's data; sections that are absent are made. A text alone stands for `--set` of it.

    Raises
    ------
    InputError
        When an override is not `key.path=value`, its value is not YAML, or its path leads through a plain value.
    """
    for override in overrides:
        if isinstance(override, str):
            override = Override(override, f"--set {override}")
        text, where = override.text, override.option
        key, equals, value_text = text.partition("=")
        steps = tuple(step.strip() for step in key.split("."))
        if not equals or not all(steps):
            raise InputError(
                "an override is key.path=value", where=where, remedy="for example --set light.height_mm=50"
            )
        given = parse_source(value_text, where, numbered=False)
        source.problems += [replace(problem, path=(*steps, *problem.path)) for problem in given.problems]
        _put(source.data, steps, given.data, where)
        stale = [path for path in source.marks if path[: len(steps)] == steps]
        for path in stale:
            del source.marks[path]
        for length in range(1, len(steps) + 1):
            source.marks.setdefault(steps[:length], Mark(where))


def _put(data: Any, steps: tuple[str, ...], value: Any, where: str) -> None:
    for i, step in enumerate(steps):
        key = _key(data, step, steps[:i], where)
        if i == len(steps) - 1:
            data[key] = value
            return
        if isinstance(data, dict) and data.get(key) is None:
            data[key] = {}
        data = data[key]


def _key(data: Any, step: str, path: tuple[str, ...], where: str) -> Any:
    """The key of a mapping or index of a list that a step of the path means."""
    place = ".".join(path)
    if isinstance(data, dict):
        known = {str(key): key for key in data}
        # A new wavelength of a table is a number, like those beside it.
        return known.get(step, float(step) if step.isdecimal() else step)
    if not isinstance(data, list):
        remedy = f"set {place} itself, or remove what follows it"
        raise InputError(f"{place} holds {told(data)}, which has no keys", where=where, remedy=remedy)
    if not step.isdecimal() or int(step) >= len(data):
        entries = f"0 to {len(data) - 1}" if data else "none, for the list is empty"
        raise InputError(f"'{step}' is no entry of the list {place}", where=where, remedy=f"its entries are {entries}")
    return int(step)
