"""What a process may leave behind: shared memory, half-written files, child processes (Linux)."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections import Counter
from pathlib import Path

from benchmarks.processes import children_of

SHARED = Path("/dev/shm")
PREFIX = f"mp{os.getpid()}"
_LASTING = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")
"""Helpers that Python starts once and keeps until its end."""


def name_semaphores() -> None:
    """Let the semaphores of this process and its workers carry its number, so that they are told from others'."""
    multiprocessing.current_process()._config["semprefix"] = f"/{PREFIX}"


def shared_memory() -> set[str]:
    """Semaphores and shared memory that this process or its workers have made and not removed."""
    return {entry.name for entry in SHARED.glob(f"*{PREFIX}-*")} if SHARED.is_dir() else set()


def children() -> set[tuple[int, str]]:
    """Number and command of the living children of this process; zombies that nobody has waited for count."""
    commands = {(child, _command(child)) for child in children_of(os.getpid())}
    return {(child, command) for child, command in commands if not any(name in command for name in _LASTING)}


def held(killed: bool = False) -> Counter[str]:
    """Shared memory and children, each by itself. Where some were `killed`, others take their places and semaphores may
    be left: only the number of children counts then."""
    each = Counter(f"child {pid}: {command}" for pid, command in children())
    return Counter({"children": each.total()}) if killed else Counter(shared_memory()) + each


def partial_files(folder: Path) -> set[Path]:
    """Files under a folder that were begun and not finished."""
    return set(folder.rglob(".*.part*"))


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return (
            Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip() or "zombie"
        )
    return "gone"
