"""The scene reference in Markdown, from the JSON Schema that `skinrender schema` prints."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

Schema = dict[str, Any]
_TABLE_HEAD = "| key | value | default | |\n|---|---|---|---|"


def scene_reference(schema: Schema) -> str:
    """A section for the scene and for each part of it, each with a table of its keys.

    Parameters
    ----------
    schema : JSON Schema of a scene file, with the parts under ``$defs``.
    """
    sections = [f"## The scene\n\n{_body(schema, schema)}"]
    for name, place in _places(schema).items():
        part = schema["$defs"][name]
        kind = _kind(part)
        title = f"`{place}`" + (f", kind `{kind}`" if kind else "")
        sections.append(f"## {title} {{ #{name.lower()} }}\n\n{_body(part, schema)}")
    return "\n\n".join(sections) + "\n"


def _places(schema: Schema) -> dict[str, str]:
    """Where each part stands in a scene, e.g. ``skin.layers.<name>``; a part's own parts follow it."""
    places: dict[str, str] = {}

    def visit(part: Schema, before: str) -> None:
        for key, value in part["properties"].items():
            for name, suffix in _parts_in(value):
                if name not in places:
                    places[name] = f"{before}{key}{suffix}"
                    visit(schema["$defs"][name], f"{places[name]}.")

    visit(schema, "")
    return places


def _parts_in(value: Any, suffix: str = "") -> Iterator[tuple[str, str]]:
    """Names of the parts that a value may be, with what its place has beyond the key."""
    if "$ref" in value:
        yield value["$ref"].rpartition("/")[2], suffix
    for choice in (*value.get("anyOf", ()), *value.get("oneOf", ())):
        yield from _parts_in(choice, suffix)
    if isinstance(value.get("items"), dict):
        yield from _parts_in(value["items"], f"{suffix}[ ]")
    if isinstance(value.get("additionalProperties"), dict):
        yield from _parts_in(value["additionalProperties"], f"{suffix}.<name>")


def _kind(part: Schema) -> str | None:
    return part["properties"].get("kind", {}).get("const")


def _body(part: Schema, schema: Schema) -> str:
    required = part.get("required", ())
    rows = [
        f"| `{key}` | {value_text(value, schema)} | {_default(value, key in required)} "
        f"| {_cell(value.get('description', ''))} |"
        for key, value in part["properties"].items()
    ]
    told = [part["description"]] if "description" in part else []
    return "\n\n".join([*told, "\n".join([_TABLE_HEAD, *rows])])


def value_text(value: Schema, schema: Schema) -> str:
    """What a key may hold, in words; parts are links to their sections."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return f"[{_kind(schema['$defs'][name]) or 'keys'}](#{name.lower()})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    for choices in ("anyOf", "oneOf"):
        if choices in value:
            return " or ".join(value_text(choice, schema) for choice in value[choices] if choice != {"type": "null"})
    match value.get("type"):
        case "array":
            return _array_text(value, schema)
        case "object":
            return _table_text(value, schema)
        case "boolean":
            return "true, false"
        case "integer" | "number":
            return ("whole number" if value["type"] == "integer" else "number") + _range_text(value)
    return "text"


def _array_text(value: Schema, schema: Schema) -> str:
    entries = value.get("prefixItems")
    if entries is None:
        return f"list of {value_text(value['items'], schema)}"
    texts = [value_text(entry, schema) for entry in entries]
    return f"{len(texts)} × {texts[0]}" if len(set(texts)) == 1 else f"[{', '.join(texts)}]"


def _table_text(value: Schema, schema: Schema) -> str:
    names = value.get("propertyNames", {}).get("enum")
    held = value_text(value["additionalProperties"], schema)
    return f"{', '.join(f'`{name}`' for name in names)}: each {held}" if names else f"table nm: {held}"


def _range_text(value: Schema) -> str:
    if "minimum" in value and "maximum" in value:
        return f" {value['minimum']:g} to {value['maximum']:g}"
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    told = [f"{sign} {value[bound]:g}" for bound, sign in signs.items() if bound in value]
    return " " + ", ".join(told) if told else ""


def _default(value: Schema, required: bool) -> str:
    if required:
        return "required"
    default = value.get("default")
    if default in (None, "", []):
        return "—"
    if isinstance(default, dict):
        return "theirs"
    return f"`{json.dumps(default)}`" if not isinstance(default, str) else f"`{default}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
