"""Reads a scene file: YAML 1.2 scalars, no surprises, and a source mark for every key.

PyYAML follows YAML 1.1, where `1e6` is text, `no` is false, `1:30` is 90 and a repeated key silently wins.
Here the node tree is composed by PyYAML and turned into plain data by the YAML 1.2 core schema.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import yaml

from skinrender.errors import InputError
from skinrender.files import printable
from skinrender.scene.problems import Mark, Problem, told

MAX_BYTES = 1_000_000
MAX_DEPTH = 20
MAX_NODES = 100_000
MAX_INT_DIGITS = 25

_TAG = "tag:yaml.org,2002:"


class CoreLoader(yaml.SafeLoader):
    """SafeLoader that resolves plain scalars by the YAML 1.2 core schema and bounds the nesting."""

    yaml_implicit_resolvers: ClassVar[dict] = {}
    depth = 0

    def compose_node(self, parent, index):
        self.depth += 1
        if self.depth > MAX_DEPTH:
            mark = self.peek_event().start_mark
            raise yaml.MarkedYAMLError(problem=f"nested deeper than {MAX_DEPTH} levels", problem_mark=mark)
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


for _kind, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", "~nN\0"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
):
    # PyYAML looks an empty scalar up under the first character "".
    CoreLoader.add_implicit_resolver(
        _TAG + _kind, re.compile(rf"(?:{_pattern})\Z"), ["" if c == "\0" else c for c in _first]
    )


@dataclass
class Source:
    """Plain data of a scene, where each of its keys stands, and what was wrong already.

    Attributes
    ----------
    data : the mapping, list or scalar read.
    marks : place of each key (mapping) or entry (list), by path of str.
    problems : mistakes that reading could step over (repeated keys, object tags).
    nodes : values read so far, aliases expanded.
    numbered : whether places have lines and columns.
    """

    data: object = None
    marks: dict[tuple[str, ...], Mark] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    nodes: int = 0
    numbered: bool = True

    def mark(self, where: str, start: yaml.Mark) -> Mark:
        """Place of a node; an override has no lines."""
        return Mark(where, start.line + 1, start.column + 1) if self.numbered else Mark(where)


def read_source(path: Path) -> Source:
    """Read a scene file. Raises InputError if it is missing, unreadable, too large or not YAML."""
    return parse_source(_read_text(path), str(path))


def parse_source(text: str, where: str, *, numbered: bool = True) -> Source:
    """Parse YAML text; `where` names it in messages, with line and column if `numbered`.

    Raises InputError when it is not YAML, or grows beyond the bounds.
    """
    source = Source(numbered=numbered)
    loader = None
    try:
        loader = CoreLoader(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        place = str(source.mark(where, error.problem_mark or error.context_mark))
        raise InputError(f"not valid YAML: {error.problem}", where=place, remedy=_syntax_remedy(error)) from None
    except yaml.reader.ReaderError as error:
        raise InputError(
            f"character {error.character:#06x} is not allowed in YAML",
            where=str(_position(where, text, error.position)) if numbered else where,
            remedy="remove it; a scene is plain UTF-8 text",
        ) from None
    finally:
        if loader is not None:
            loader.dispose()
    if node is not None:
        source.data = _construct(node, (), source, where)
    return source


def _read_text(path: Path) -> str:
    if os.path.isdir(path):
        raise InputError("is a folder, not a scene file", where=str(path), remedy="name a .yaml file in it")
    if not os.path.exists(path):
        raise InputError("no such scene file", where=str(path), remedy=_files_nearby(path))
    if not os.path.isfile(path):
        raise InputError("is not a regular file", where=str(path), remedy="name a .yaml file")
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if len(raw) > MAX_BYTES:
        raise InputError(
            f"is larger than {MAX_BYTES // 1000} kB", where=str(path), remedy="a scene is text; is it an image?"
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"is not UTF-8 text (byte {raw[error.start]:#04x})",
            where=f"{path}:{raw.count(10, 0, error.start) + 1}:1",
            remedy="save it as UTF-8",
        ) from None


def _files_nearby(path: Path) -> str:
    folder = path.parent
    if not os.path.isdir(folder):
        return f"the folder '{folder}' does not exist either"
    scenes = sorted(p.name for p in folder.glob("*.yaml"))[:8]
    return f"scenes in '{folder}': {', '.join(scenes)}" if scenes else f"there is no .yaml file in '{folder}'"


def _syntax_remedy(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or ""
    if "'\\t'" in problem:
        return "indent with spaces, not tabs"
    if "single document" in (error.context or ""):
        return "keep one document: remove everything from the second '---' on"
    if "undefined alias" in problem:
        return "define the anchor (&name) above its use (*name)"
    if "nested deeper" in problem:
        return "a scene needs no such depth"
    return "check the indentation, colons, brackets and quotes at and just above this place"


def _position(where: str, text: str, position: int) -> Mark:
    before = text[:position]
    return Mark(where, before.count("\n") + 1, position - before.rfind("\n"))


def _construct(node: yaml.Node, path: tuple[str, ...], source: Source, where: str) -> object:
    """Plain data of a node; aliases are expanded, so the number of nodes visited is bounded."""
    source.nodes += 1
    mark = source.mark(where, node.start_mark)
    if source.nodes > MAX_NODES or len(path) > MAX_DEPTH:
        raise InputError(
            f"its aliases expand to more than {MAX_NODES} values or {MAX_DEPTH} levels",
            where=str(mark),
            remedy="write the values out, or use fewer aliases",
        )
    source.marks.setdefault(path, mark)
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node, path, source, mark)
    kind = "map" if isinstance(node, yaml.MappingNode) else "seq"
    if node.tag != _TAG + kind:
        source.problems.append(_tag_problem(node, path, mark))
    if kind == "seq":
        return [_construct(child, (*path, str(i)), source, where) for i, child in enumerate(node.value)]
    return _mapping(node, path, source, where)


def _mapping(node: yaml.MappingNode, path: tuple[str, ...], source: Source, where: str) -> dict:
    data: dict = {}
    for key_node, value_node in node.value:
        mark = source.mark(where, key_node.start_mark)
        if not isinstance(key_node, yaml.ScalarNode):
            source.problems.append(Problem(path, "a key must be a plain word, not a list or mapping", mark))
            continue
        key = _scalar(key_node, path, source, mark)
        if key is None or isinstance(key, bool):
            text = f"the key '{key_node.value}' stands for {told(key)}; a key is a plain word, or a wavelength in a table"
            source.problems.append(Problem(path, text, mark))
            continue
        at = (*path, str(key))
        if key in data:
            text = f"this key stands here a second time (first at {source.marks[at]}); keep one of them"
            source.problems.append(Problem(at, text, mark))
            continue
        source.marks[at] = mark
        data[key] = _construct(value_node, at, source, where)
    return data


def _scalar(node: yaml.ScalarNode, path: tuple[str, ...], source: Source, mark: Mark) -> object:
    text, kind = node.value, node.tag.removeprefix(_TAG)
    try:
        match kind:
            case "str":
                if (kept := printable(text)) != text:
                    problem = f"got {told(text)}, half of a surrogate pair; write the character itself, or as \\U0001F600"
                    source.problems.append(Problem(path, problem, mark))
                return kept
            case "null":
                return None
            case "bool":
                return text.lower() == "true"
            case "int" if len(text) <= MAX_INT_DIGITS:
                return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
            case "int" | "float":
                return float(re.sub(r"^([-+]?)\.(inf|nan)$", r"\1\2", text.lower()))
    except ValueError:
        # Only an explicit tag (`!!int abc`) leads here.
        source.problems.append(Problem(path, f"'{text}' does not fit its tag !!{kind}; remove the tag", mark))
        return text
    source.problems.append(_tag_problem(node, path, mark))
    return text


def _tag_problem(node: yaml.Node, path: tuple[str, ...], mark: Mark) -> Problem:
    tag = node.tag.replace(_TAG, "!!")
    return Problem(path, f"the tag {tag} is not allowed; a scene holds plain values only, remove the tag", mark)
