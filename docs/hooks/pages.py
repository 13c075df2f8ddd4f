"""The site's generated parts: each marker in a page gives way to what the program itself says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from command_reference import command_reference
from notebook import notebook
from scene_reference import scene_reference

from skinrender.scene import json_schema

EXAMPLE = Path(__file__).parents[1] / "examples" / "more_melanin.py"
MARKERS: dict[str, Callable[[], str]] = {
    "<!-- generated: scene reference -->": lambda: scene_reference(json_schema()),
    "<!-- generated: command reference -->": command_reference,
    "<!-- generated: example -->": lambda: notebook(EXAMPLE.read_text(encoding="utf-8")),
}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs for each page."""
    for marker, generate in MARKERS.items():
        if marker in markdown:
            markdown = markdown.replace(marker, generate())
    return markdown
