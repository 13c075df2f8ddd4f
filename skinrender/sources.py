"""Fingerprints of the program's own sources: what was made by other code has to be made again."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent


@cache
def sources_hash(places: tuple[str, ...]) -> str:
    """SHA-256 (its first 16 hex digits) over some of the program's sources and tables.

    Parameters
    ----------
    places : files or folders, relative to the package.
    """
    digest = hashlib.sha256()
    for place in places:
        path = PACKAGE / place
        files = [path] if path.is_file() else (file for file in path.rglob("*") if file.suffix in (".py", ".csv"))
        for file in sorted(files):
            digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]
