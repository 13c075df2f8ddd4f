"""Files: how their names and sizes are told, and what is looked at before those that a user names are opened."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from skinrender.errors import InputError


def printable(name: object) -> str:
    """A name as text that can be printed and saved: what is no text, in a name of another encoding, becomes ``?``."""
    return str(name).encode("utf-8", "replace").decode()


def bytes_text(count: float) -> str:
    """A size as people read it."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def refuse_special(path: str | Path) -> None:
    """Raise InputError for what is no plain file, as reading it may never end: pipes, devices; and for impossible names.

    Missing files and folders pass: opening them fails at once, and the opener has more to say of them.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        told = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"cannot be read: {told}", where=str(path), remedy="name a file that can be read") from error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError("is not a regular file", where=str(path), remedy="name a file; save what comes by a pipe first")
