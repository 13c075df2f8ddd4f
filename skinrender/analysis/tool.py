"""What the tools ``python -m skinrender.analysis.*`` share: options by argparse, a failure as one message and a code."""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Callable, Sequence

from skinrender.errors import InputError, RunError


def options(documentation: str) -> argparse.ArgumentParser:
    """A parser that describes itself by the first line of a module's documentation."""
    return argparse.ArgumentParser(description=documentation.split("\n")[0])


def tool(work: Callable[[Sequence[str] | None], None]) -> Callable[[Sequence[str] | None], int]:
    """Have what works on a command line's arguments (None: the process's own) return the exit code."""

    @functools.wraps(work)
    def main(arguments: Sequence[str] | None = None) -> int:
        try:
            work(arguments)
        except (InputError, RunError) as error:
            wrong = isinstance(error, InputError)
            print(f"{'error' if wrong else 'failed'}: {error}", file=sys.stderr)
            return 2 if wrong else 1
        return 0

    return main
