"""Refusing what memory cannot hold, before any of it is made."""

from __future__ import annotations

import os
import resource
from pathlib import Path

from skinrender.errors import SceneError


def available_bytes() -> int:
    """Memory that can be had without swapping."""
    meminfo = Path("/proc/meminfo")
    if meminfo.exists():
        for line in meminfo.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def peak_bytes() -> int:
    """The most memory that this process ever held."""
    status = Path("/proc/self/status")
    if status.exists():  # the system's account of a child begins with what its parent held
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def require_memory(needed_bytes: int, what: str, *, key: tuple[str, ...], remedy: str) -> None:
    """Raise SceneError when ``what``, which follows from the scene's value of that key, takes more memory than there is."""
    available = available_bytes()
    if needed_bytes > available:
        told = f"{what} takes {needed_bytes / 1e9:.1f} GB of memory, {available / 1e9:.1f} GB are free"
        raise SceneError(told, key=key, remedy=remedy)
