"""What ``--version`` tells."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version


def version_lines() -> list[str]:
    """Own version, then those of what computes, then the machine."""
    from skinrender.engine.clock import cpu_name

    lines = [f"{name} {_version(name)}" for name in ("skinrender", "numba", "numpy")]
    return [*lines, f"python {platform.python_version()}", f"CPU {cpu_name()}, {os.cpu_count()} cores"]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "(not installed)"
