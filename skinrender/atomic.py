"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skinrender.errors import RunError

_PARTIAL = re.compile(r"\..*\.(\d+)\.part(\.\w+)?", re.DOTALL)


def clear_partial_files(folder: Path) -> None:
    """Delete what killed processes left half written in a folder; what a living one is writing stays."""
    for partial in folder.glob(".*.part*"):
        if (found := _PARTIAL.fullmatch(partial.name)) and not _is_another_alive(int(found[1])):
            partial.unlink(missing_ok=True)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary name in the same folder; on success it is synced and renamed to `path`, else removed.

    Raises
    ------
    RunError : the file cannot be written; `path` is as it was before.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")  # what writes it may go by the suffix
    try:
        try:
            yield temporary
            _sync(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        _sync(path.parent)
    except OSError as error:
        raise RunError(f"{path}: cannot be written ({error.strerror or error})") from error


def remove(path: Path) -> None:
    """Delete a file that is to be made again, if it is there; raises `RunError` where it cannot be."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(f"{path}: cannot be written ({error.strerror or error})") from error


def _is_another_alive(pid: int) -> bool:
    if pid == os.getpid():
        return False  # a namesake's: in a container the same few numbers come again
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
