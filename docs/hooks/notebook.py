"""A Python script of ``# %%`` cells, as a page: its text cells as text, its code cells as code."""

from __future__ import annotations

_CELL, _TEXT = "# %%", "# %% [markdown]"


def notebook(source: str) -> str:
    """Markdown of a script; what stands before the first cell is left out."""
    cells: list[list[str]] = []
    for line in source.splitlines():
        if line.startswith(_CELL):
            cells.append([])
        if cells:
            cells[-1].append(line)
    return "\n\n".join(_markdown(head, body) for head, *body in cells) + "\n"


def _markdown(head: str, body: list[str]) -> str:
    if head.startswith(_TEXT):
        return "\n".join(line.removeprefix("#").removeprefix(" ") for line in body).strip()
    return "```python\n" + "\n".join(body).strip() + "\n```"
