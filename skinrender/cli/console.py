"""What a command says: its result on stdout, everything else on stderr."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import click

from skinrender.files import printable

Row = tuple[str, str]


@dataclass(frozen=True)
class Console:
    """How much is said, and in which form.

    Parameters
    ----------
    quiet : say nothing but results in JSON, warnings and errors.
    verbose : also say what each step decides, and tabulate the bands.
    as_json : the result is one JSON object, the only thing on stdout.
    """

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False

    @property
    def progress(self) -> bool:
        """Whether progress bars are wanted (they appear on terminals only)."""
        return not self.quiet

    def detail(self, text: str) -> None:
        """Say what was decided, if asked."""
        if self.verbose:
            click.echo(text, err=True)

    def warn(self, text: str) -> None:
        """Say what the user should know."""
        click.echo(f"{marked('warning:', 'yellow')} {text}", err=True)

    def result(self, summary: Mapping[str, Any], rows: Iterable[Row]) -> None:
        """Print the result: the summary in JSON, or rows of (label, value) as a table."""
        if self.as_json:
            click.echo(printable(json.dumps(_finite(summary), indent=2, ensure_ascii=False, allow_nan=False)))
        elif not self.quiet:
            click.echo(aligned(rows))


def marked(word: str, color: str) -> str:
    """A word that stands out; where the output is no terminal click takes the color away."""
    return click.style(word, fg=color, bold=True)


def aligned(rows: Iterable[Row]) -> str:
    """Labels and values in two columns."""
    rows = list(rows)
    width = max((len(label) for label, _ in rows), default=0)
    return "\n".join(f"{label:<{width}}  {value}".rstrip() for label, value in rows)


def with_error(pair: Mapping[str, float | None]) -> str:
    """A value and its standard error, rounded to two digits of the error."""
    value, error = pair["value"], pair["stderr"]
    if not error:
        return f"{value:.6g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    if digits > 9:
        return f"{value:.6g} ± {error:.2g}"
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def seconds_row(seconds: Mapping[str, float]) -> Row:
    """Seconds by stage."""
    return "seconds", ", ".join(f"{stage} {spent:.2f}" for stage, spent in seconds.items())


def _finite(value: Any) -> Any:
    """JSON knows neither NaN nor infinity: they become null."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
