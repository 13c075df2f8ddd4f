"""Turns what pydantic finds wrong into messages for the writer of a scene.

What is allowed at a place is read from the JSON Schema, so the messages can not fall behind the models.
"""

from __future__ import annotations

import functools
from typing import Any

from pydantic import ValidationError

from skinrender.scene.problems import Problem, did_you_mean, told
from skinrender.scene.schema import json_schema

_YES_NO = {"yes": "true", "on": "true", "no": "false", "off": "false"}


# Making the schema takes longer than all else here.
_schema = functools.cache(json_schema)


def validation_problems(error: ValidationError, data: Any) -> list[Problem]:
    """One problem for each thing that pydantic found wrong with `data`."""
    items = error.errors(include_url=False)
    return [_problem(item, data, _schema()) for item in items if not _only_follows(item, items)]


def _only_follows(item: dict[str, Any], items: list[dict[str, Any]]) -> bool:
    """Whether a list is called too short only because the entries that are wrong were not counted."""
    loc = item["loc"]
    return item["type"] == "too_short" and any(
        other["loc"][: len(loc)] == loc and len(other["loc"]) > len(loc) for other in items
    )


def _problem(item: dict[str, Any], data: Any, root: dict[str, Any]) -> Problem:
    kind, loc = item["type"], item["loc"]
    path, at_key = _data_path(loc, data, ends_with_key=kind in ("missing", "extra_forbidden", "invalid_key"))
    value = _value_at(data, path)
    if kind == "missing" and loc and isinstance(loc[-1], int):
        # A pair with one entry: the missing thing is the pair's fault.
        path = path[:-1]
        value = _value_at(data, path)
    elif kind == "missing":
        return Problem(path, _missing(_node_at(root, path, data)))
    elif kind in ("extra_forbidden", "invalid_key"):
        section = _value_at(data, path[:-1])
        return Problem(path, _unknown_key(path[-1], section, _node_at(root, path[:-1], data)))
    if kind == "union_tag_invalid":
        kinds, tag = _kinds(_follow(root, path, data), root), item["ctx"]["tag"]
        return Problem((*path, "kind"), f"got {told(tag)}; allowed: {_quoted(kinds)}{did_you_mean(tag, kinds)}")
    elif kind == "union_tag_not_found":
        kinds = _kinds(_follow(root, path, data), root)
        return Problem((*path, "kind"), f"missing; allowed: {_quoted(kinds)}")
    if kind == "scene":
        return Problem(path, item["ctx"]["text"])
    if at_key:
        return Problem(path, _wrong_key(path[-1], _node_at(root, path[:-1], data)))
    return Problem(path, f"got {told(value)}; " + _remedy(value, path, data, root))


def _data_path(loc: tuple, data: Any, *, ends_with_key: bool) -> tuple[tuple[str, ...], bool]:
    """Path in the user's data of pydantic's loc, which also holds names of union members; True if a key is meant."""
    path: list[str] = []
    for i, step in enumerate(loc):
        if step == "[key]":
            return tuple(path), True
        known = {str(key): key for key in data} if isinstance(data, dict) else {}
        if str(step) in known:
            data = data[known[str(step)]]
        elif isinstance(data, (list, tuple)) and isinstance(step, int):
            data = data[step] if step < len(data) else None
        elif not (ends_with_key and i == len(loc) - 1):
            continue
        path.append(str(step))
    return tuple(path), False


def _value_at(data: Any, path: tuple[str, ...]) -> Any:
    for step in path:
        if isinstance(data, dict):
            data = next((value for key, value in data.items() if str(key) == step), None)
        elif isinstance(data, (list, tuple)) and int(step) < len(data):
            data = data[int(step)]
        else:
            return None
    return data


def _resolve(node: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in node:
        node = {**root["$defs"][node["$ref"].rpartition("/")[2]], **{k: v for k, v in node.items() if k != "$ref"}}
    return node


def _members(node: dict[str, Any], root: dict[str, Any]) -> list[dict[str, Any]]:
    """The alternatives of a node (itself if it has none), null left out."""
    node = _resolve(node, root)
    alternatives = node.get("anyOf") or node.get("oneOf")
    if not alternatives:
        return [node]
    members = [member for part in alternatives for member in _members(part, root)]
    return [member for member in members if member.get("type") != "null"]


def _kinds(node: dict[str, Any], root: dict[str, Any]) -> list[str]:
    constants = [member.get("properties", {}).get("kind", {}).get("const") for member in _members(node, root)]
    return [constant for constant in constants if constant]


def _pick(node: dict[str, Any], value: Any, root: dict[str, Any]) -> dict[str, Any]:
    """The alternative of a node that the value belongs to."""
    members = _members(node, root)
    if not isinstance(value, dict):
        wanted = "array" if isinstance(value, (list, tuple)) else None
        return next((m for m in members if m.get("type") == wanted), members[0])
    objects = [member for member in members if member.get("type") == "object"] or members
    for member in objects:
        kind = member.get("properties", {}).get("kind", {})
        if "kind" in value and kind.get("const") == value["kind"]:
            return member
        if "kind" not in value and "kind" not in member.get("required", ()):
            return member
    return objects[0]


def _follow(root: dict[str, Any], path: tuple[str, ...], data: Any) -> dict[str, Any]:
    """JSON Schema node of a path, alternatives not yet picked; {} where the schema ends."""
    node = root
    for i, step in enumerate(path):
        node = _pick(node, _value_at(data, path[:i]), root)
        if "properties" in node or "additionalProperties" in node:
            more = node.get("additionalProperties") or {}
            node = node.get("properties", {}).get(step, more)
        elif "prefixItems" in node:
            node = node["prefixItems"][min(int(step), len(node["prefixItems"]) - 1)]
        else:
            node = node.get("items", {})
    return node


def _node_at(root: dict[str, Any], path: tuple[str, ...], data: Any) -> dict[str, Any]:
    return _pick(_follow(root, path, data), _value_at(data, path), root)


def _quoted(words: list[str]) -> str:
    return ", ".join(f"'{word}'" for word in words)


def _missing(node: dict[str, Any]) -> str:
    description = node.get("description", "")
    return "missing; add it" + (f": {description}" if description else "")


def _unknown_key(key: str, section: Any, node: dict[str, Any]) -> str:
    allowed = list(node.get("properties", {}))
    kind = node.get("properties", {}).get("kind", {}).get("const")
    here = f"unknown key of kind '{kind}'" if kind else "unknown key"
    free = [name for name in allowed if not isinstance(section, dict) or name not in section]
    return f"{here}; allowed: {', '.join(allowed)}{did_you_mean(key, free)}"


def _wrong_key(key: str, node: dict[str, Any]) -> str:
    names = node.get("propertyNames", {}).get("enum")
    if names:
        return f"unknown name; allowed: {', '.join(names)}{did_you_mean(key, names)}"
    return f"got the key {told(key)}; a table's keys are wavelengths in nm, 100 to 3000"


def _remedy(value: Any, path: tuple[str, ...], data: Any, root: dict[str, Any]) -> str:
    node = _follow(root, path, data)
    members = _members(node, root)
    words = [word for member in members for word in _words(member)]
    if words:
        return f"allowed: {_quoted(words)}{did_you_mean(value, words)}"
    kinds = _kinds(node, root)
    if kinds:
        return f"expected a mapping with 'kind', which is one of {_quoted(kinds)}"
    text = "expected " + " or ".join(_expected(member, root) for member in members)
    if isinstance(value, str) and value.lower() in _YES_NO and members[0].get("type") == "boolean":
        text += f" (did you mean '{_YES_NO[value.lower()]}'?)"
    elif isinstance(value, str) and members[0].get("type") in ("number", "integer"):
        text += ", without quotes or unit"
    elif not isinstance(value, (str, dict, list, tuple)) and members[0].get("type") == "string":
        text += "; put it in quotes"
    return text


def _words(node: dict[str, Any]) -> list[str]:
    return node.get("enum") or ([node["const"]] if "const" in node else [])


def _expected(node: dict[str, Any], root: dict[str, Any]) -> str:
    """What a schema node accepts, in words."""
    match node.get("type"):
        case "number":
            return "a number" + _bounds(node)
        case "integer":
            return "a whole number" + _bounds(node)
        case "boolean":
            return "true or false"
        case "string":
            return "text" + _lengths(node, "Length", "characters") + (" without / or \\" if "pattern" in node else "")
        case "array":
            return _expected_list(node, root)
        case "object" if "properties" in node:
            return f"a mapping with the keys {', '.join(node['properties'])}"
        case "object" if "propertyNames" in node:
            return "a mapping from layer names"
        case "object":
            return "a table {wavelength_nm: " + _expected(node["additionalProperties"], root) + "}"
    return "another value"


def _expected_list(node: dict[str, Any], root: dict[str, Any]) -> str:
    if "prefixItems" in node:
        return f"a list of {len(node['prefixItems'])}, each {_expected(_resolve(node['prefixItems'][0], root), root)}"
    members = _members(node["items"], root)
    kinds = _kinds(node["items"], root)
    each = "a mapping of kind " + " or ".join(kinds) if kinds else _expected(members[0], root)
    return f"a list{_lengths(node, 'Items', 'entries')}, each {each}"


def _lengths(node: dict[str, Any], what: str, unit: str) -> str:
    low, high = node.get(f"min{what}"), node.get(f"max{what}")
    if low is not None and high is not None:
        return f" of {low} to {high} {unit}"
    return f" of at least {low} {unit}" if low else ""


def _bounds(node: dict[str, Any]) -> str:
    names = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
    bounds = [f"{sign} {_number(node[name])}" for name, sign in names if name in node]
    return " " + " and ".join(bounds) if bounds else ""


def _number(bound: float) -> str:
    return str(bound) if isinstance(bound, int) else f"{bound:.15g}"
