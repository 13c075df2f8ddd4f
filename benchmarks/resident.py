"""The most memory that a command and its children held at once, and what it took."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.processes import tree

SAMPLE_SECONDS = 0.25


@dataclass(frozen=True)
class Resident:
    """Bytes in memory at one moment.

    Parameters
    ----------
    total : proportional resident set: a page shared by processes counts once, pages of mapped files included.
    own : the part that no file backs; mapped pages can be dropped by the system at any time.
    """

    total: int = 0
    own: int = 0

    def most(self, other: Resident) -> Resident:
        """The larger of each."""
        return Resident(max(self.total, other.total), max(self.own, other.own))


@dataclass(frozen=True)
class Watched:
    """A finished command of the program: its JSON, wall and CPU seconds of it and its children, its peak of memory."""

    summary: dict[str, Any]
    seconds: float
    cpu_seconds: float
    peak: Resident


def run_watched(*arguments: str) -> Watched:
    """Run ``skinrender ARGUMENTS --json`` in a process of its own and look at its memory four times a second.

    Raises
    ------
    subprocess.CalledProcessError : the command failed.
    """
    command = [sys.executable, "-m", "skinrender.cli", *arguments, "--json", "-q"]
    began, before = time.perf_counter(), os.times()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        told: list[str] = []
        reader = threading.Thread(target=lambda: told.append(process.stdout.read()))
        reader.start()
        peak = Resident()
        while process.poll() is None:
            peak = peak.most(resident_of_tree(process.pid))
            time.sleep(SAMPLE_SECONDS)
        reader.join()
    after = os.times()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Watched(json.loads(told[0]), time.perf_counter() - began, cpu, peak)


def resident_of_tree(pid: int) -> Resident:
    """Memory of a process and all its descendants (Linux: ``smaps_rollup``)."""
    parts = [_resident(one) for one in tree(pid)]
    return Resident(sum(part.total for part in parts), sum(part.own for part in parts))


def _resident(pid: int) -> Resident:
    values: dict[str, int] = {}
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
            name, value, *_ = line.split()
            values[name] = 1024 * int(value)
    return Resident(values.get("Pss:", 0), values.get("Pss_Anon:", 0) + values.get("Pss_Shmem:", 0))
