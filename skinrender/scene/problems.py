"""A mistake in a scene, where it stands, and how it is told."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from skinrender.errors import InputError


@dataclass(frozen=True, order=True)
class Mark:
    """Place of a key: a file with line and column from 1, or an override (line 0)."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(frozen=True)
class Places:
    """The marks of a scene's values, by path. Any two are equal: a scene is what it holds, wherever that stands."""

    marks: Mapping[tuple[str, ...], Mark] = field(default_factory=dict, compare=False)


@dataclass(frozen=True)
class Problem:
    """One mistake: path of the key, what is wrong and what to do, and where if known."""

    path: tuple[str, ...]
    text: str
    mark: Mark | None = None

    def located(self, marks: Mapping[tuple[str, ...], Mark]) -> Problem:
        """With the mark of the path, or of the nearest section around it."""
        if self.mark is not None:
            return self
        return Problem(self.path, self.text, nearest_mark(self.path, marks))

    def __str__(self) -> str:
        parts = (str(self.mark) if self.mark else "", ".".join(self.path), self.text)
        return ": ".join(part for part in parts if part)


def nearest_mark(path: tuple[str, ...], marks: Mapping[tuple[str, ...], Mark]) -> Mark | None:
    """The mark of a path, or of the nearest section around it."""
    lengths = range(len(path), -1, -1)
    return next((marks[path[:n]] for n in lengths if path[:n] in marks), None)


def raise_problems(problems: Iterable[Problem], marks: Mapping[tuple[str, ...], Mark]) -> None:
    """Raise one InputError that tells all problems, in the order of the file; nothing if there are none."""
    located = [problem.located(marks) for problem in problems]
    # Overrides (line 0) come after the file's own lines.
    located.sort(key=lambda p: (p.mark.line == 0, p.mark.line, p.mark.column) if p.mark else (True, 0, 0))
    lines = dict.fromkeys(str(problem) for problem in located)
    if lines:
        raise InputError("\n".join(lines))


def did_you_mean(given: object, allowed: Iterable[str]) -> str:
    """` (did you mean 'point'?)`, or nothing if no allowed word is near."""
    by_lower = {word.lower(): word for word in allowed}
    word = str(given).lower()
    near = [name for name in by_lower if len(word) > 1 and name.startswith(word)]
    near = near or difflib.get_close_matches(word, by_lower, n=1, cutoff=0.55)
    return f" (did you mean '{by_lower[near[0]]}'?)" if near else ""


def told(value: object) -> str:
    """A value as it is quoted in a message."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case dict():
            return "a mapping" if value else "an empty mapping"
        case list() | tuple():
            return f"a list of {len(value)}" if value else "an empty list"
        case str():
            return repr(value if len(value) <= 60 else value[:57] + "...")
        case float():
            return f"{value:.10g}"
    text = str(value)
    return text if len(text) <= 30 else text[:27] + "..."
