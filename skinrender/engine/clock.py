"""Seconds of each stage, as in the paper's table 1: load, trace, estimate, total."""

from __future__ import annotations

import csv
import os
import platform
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

VERSIONS = ("skinrender", "numpy", "numba")
COLUMNS = ("finished", "command", "stage", "seconds", "workers", "host", "cpu", "cores", "python", *VERSIONS)


class StageClock:
    """Adds up wall-clock seconds by stage."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block as part of stage `name`."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - began

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage, in the order of their beginning, and their sum as ``total``."""
        return self._seconds | {"total": sum(self._seconds.values())}


def append_timing(path: Path, seconds: Mapping[str, float], *, command: str, workers: int) -> None:
    """Add a row for each stage to a ``timing.csv``, making it if need be."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    where = [workers, socket.gethostname(), cpu_name(), os.cpu_count(), platform.python_version(), *_versions()]
    with open(path, "a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if file.tell() == 0:
            writer.writerow(COLUMNS)
        writer.writerows([now, command, stage, f"{spent:.6g}", *where] for stage, spent in seconds.items())


def cpu_name() -> str:
    """The processor's name as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _versions() -> list[str]:
    found = []
    for name in VERSIONS:
        try:
            found.append(version(name))
        except PackageNotFoundError:
            found.append("")
    return found
