"""The one place where what went wrong becomes a message on stderr and an exit code."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any, NoReturn

import click

from skinrender.cli.console import marked
from skinrender.engine.interrupt import stopped_at_once
from skinrender.errors import InputError, RunError

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
_ERROR, _FAILED = marked("error:", "red"), marked("failed:", "red")
_KEPT = "interrupted; what was finished is kept\n  go on with the same command (trace and render: and --resume)"
_REMEDIES = {
    errno.ENOSPC: "free some room on the disk, or choose another with -o",
    errno.EDQUOT: "free some of your quota, or choose another disk with -o",
    errno.EROFS: "choose a folder that can be written with -o",
    errno.EACCES: "make it readable and writable for you, or choose another folder with -o",
    errno.EPERM: "make it readable and writable for you, or choose another folder with -o",
    errno.EMFILE: "allow more open files (ulimit -n), or use fewer --workers",
}


class FailureGroup(click.Group):
    """Turns every failure that a user can cause into one message and an exit code; all others stay visible."""

    def main(self, *args: Any, **extra: Any) -> Any:
        try:
            return super().main(*args, **extra)
        except OSError as error:  # of printing help itself; the commands' own are told below
            click.echo(f"{_FAILED} {_told(error)}", err=True)
            sys.exit(FAILED)

    def invoke(self, ctx: click.Context) -> Any:
        ctx.color = False if os.environ.get("NO_COLOR") else None  # None: on a terminal only
        _open_closed_streams()
        try:
            with stopped_at_once():
                result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except InputError as error:
            _stop(ctx, f"{_ERROR} {error}", BAD_INPUT)
        except RunError as error:
            _stop(ctx, f"{_FAILED} {_with_remedy(str(error), error.__cause__)}", FAILED)
        except KeyboardInterrupt as error:
            _stop(ctx, str(error) or _KEPT, INTERRUPTED)
        except BrokenPipeError:
            # Whoever read our output has gone: nothing to tell, and nothing for the interpreter to flush at its end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(FAILED)
        except OSError as error:
            _stop(ctx, f"{_FAILED} {_told(error)}", FAILED)
        except MemoryError:
            _stop(ctx, f"{_FAILED} out of memory\n  use fewer columns, pixels or --workers", FAILED)


def _open_closed_streams() -> None:
    """Where the caller closed stdout or stderr (``>&-``), speak to nobody: the next file opened must not take its place."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))


def _stop(ctx: click.Context, message: str, code: int) -> NoReturn:
    click.echo(message, err=True)
    ctx.exit(code)


def _told(error: OSError) -> str:
    return _with_remedy(f"{error.filename}: {error.strerror}" if error.filename else str(error), error)


def _with_remedy(text: str, cause: BaseException | None) -> str:
    """Add what helps against the system's refusal, if that was the cause and nothing is advised yet."""
    remedy = _REMEDIES.get(cause.errno or 0) if isinstance(cause, OSError) else None
    return f"{text}\n  {remedy}" if remedy and "\n" not in text else text
