"""Room on the disk: asked for beforehand, and said plainly when it runs out."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skinrender.errors import RunError
from skinrender.files import bytes_text

KEPT = "finished rounds are kept: free some room or make the folder writable, then go on with --resume"


def check_free_space(folder: Path, needed_bytes: float) -> None:
    """Raise `RunError` if `folder`'s disk has less than `needed_bytes` left."""
    free = shutil.disk_usage(folder).free
    if needed_bytes > free:
        raise RunError(
            f"{folder}: the run needs about {bytes_text(needed_bytes)}, the disk has {bytes_text(free)} left\n"
            "  free some room, choose another disk with -o, or lower photons.stored"
        )


@contextmanager
def disk_errors(folder: Path) -> Iterator[None]:
    """Turn a full or read-only disk, within the block, into a `RunError` that says how to go on."""
    try:
        yield
    except OSError as error:
        raise RunError(f"{error.filename or folder}: cannot be written ({error.strerror})\n  {KEPT}") from error
    except RunError as error:
        if isinstance(error.__cause__, OSError) and KEPT not in str(error):
            raise RunError(f"{error}\n  {KEPT}") from error.__cause__
        raise
