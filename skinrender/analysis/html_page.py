"""Pages of one file: no script, nothing loaded, every text escaped."""

from __future__ import annotations

import base64
import html
import itertools
from collections.abc import Iterable, Sequence

STYLE = """
body { font: 15px/1.45 Georgia, 'Times New Roman', serif; color: #2b2320; background: #fff; max-width: 62em; margin: 2.5em auto;
       padding: 0 1.5em; }
h1 { font-size: 1.7em; margin: 0 0 .2em; font-weight: normal; }
h2 { font-size: 1.25em; margin: 2.2em 0 .6em; font-weight: normal; border-bottom: 1px solid #cbbfb6; padding-bottom: .2em; }
h3 { font-size: 1.05em; margin: 1.4em 0 .4em; font-weight: bold; }
p, li { max-width: 48em; }
p.lead, .soft { color: #6a5a52; }
table { border-collapse: collapse; margin: .6em 0 1.2em; font: 12.5px/1.5 'Helvetica Neue', Arial, sans-serif; }
caption { text-align: left; color: #6a5a52; padding-bottom: .4em; max-width: 60em; }
th { text-align: right; font-weight: 600; border-bottom: 1px solid #8a7a72; padding: .2em .5em; vertical-align: bottom; }
td { text-align: right; padding: .1em .5em; border-bottom: 1px solid #eee6e0; font-variant-numeric: tabular-nums; white-space: nowrap; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td.text { white-space: normal; }
tr.good td:last-child { color: #1d6b3a; background: #e9f4ec; } tr.bad td { background: #fbe6e1; }
tr.bad td:last-child { color: #a01c08; font-weight: bold; }
figure { margin: 1em 0 1.6em; break-inside: avoid; }
figure img { max-width: 100%; height: auto; display: block; }
figcaption { color: #6a5a52; font-size: .92em; max-width: 52em; margin-top: .4em; }
code { font: 12.5px/1.4 Menlo, Consolas, monospace; background: #f6f1ed; padding: .05em .3em; overflow-wrap: anywhere; }
@media print { * { print-color-adjust: exact; } body { margin: 0; max-width: none; font-size: 11px; } table { font-size: 8.5px; } h2 { break-after: avoid; }
               th, td { padding: .08em .35em; } tr { break-inside: avoid; } }
@page { size: A4; margin: 16mm; }
"""


def text(value: object) -> str:
    """Escaped."""
    return html.escape(str(value))


def page(title: str, parts: Iterable[str]) -> str:
    """A whole document; `title` is escaped, the parts are HTML."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{text(title)}</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def table(
    head: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "", text_columns: int = 1,
    good: Sequence[bool] | None = None,
) -> str:  # fmt: skip
    """A table of escaped cells.

    Parameters
    ----------
    text_columns : how many of the first columns hold text, not numbers.
    good : verdict of each row, which colors it; its last column says the same in words.
    """

    def line(tag: str, cells: Sequence[object], kind: str = "") -> str:
        marked = (
            f"<{tag}{' class=text' if i < text_columns else ''}>{text(cell)}</{tag}>" for i, cell in enumerate(cells)
        )
        return f"<tr{kind}>{''.join(marked)}</tr>"

    told = f"<caption>{text(caption)}</caption>" if caption else ""
    kinds = itertools.repeat("") if good is None else (f" class={'good' if ok else 'bad'}" for ok in good)
    body = "\n".join(line("td", row, kind) for row, kind in zip(rows, kinds))
    return f"<table>{told}<thead>{line('th', head)}</thead>\n<tbody>{body}</tbody></table>"


def figure(data: bytes, kind: str, caption: str, alternative: str, width_px: int | None = None) -> str:
    """A picture inside the page: its bytes, as ``png`` or ``svg``; of its own width by default."""
    mime = {"png": "image/png", "svg": "image/svg+xml"}[kind]
    source = f"data:{mime};base64,{base64.b64encode(data).decode('ascii')}"
    size = "" if width_px is None else f' width="{width_px}"'
    return (
        f'<figure><img src="{source}" alt="{text(alternative)}"{size}><figcaption>{text(caption)}</figcaption></figure>'
    )


def items(lines: Iterable[str]) -> str:
    """A list of escaped lines."""
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>"
