"""One run at a time in a folder."""

from __future__ import annotations

import fcntl
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skinrender.atomic import clear_partial_files
from skinrender.errors import InputError

LOCK_NAME = ".skinrender.lock"


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold `folder` for this process while the block runs; what killed runs left half written in it is deleted.

    The kernel's lock on the file tells the living from the dead on this host; the name of the host inside it guards
    folders shared between hosts. A lock left behind by a dead process of this host is taken over.

    Raises `InputError` if another run has the folder.
    """
    path = folder / LOCK_NAME
    descriptor = _acquire(path)
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps({"host": socket.gethostname(), "pid": os.getpid()}).encode(), 0)
        clear_partial_files(folder)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)


def _acquire(path: Path) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = _owner(descriptor)
            os.close(descriptor)
            host, pid = owner.get("host", "?"), owner.get("pid", "?")
            raise InputError(
                f"another run (process {pid} on host {host}) is at work in this folder",
                where=str(path.parent),
                remedy="wait until it has ended, or choose another folder with -o",
            ) from None
        if not _is_still_there(path, descriptor):
            os.close(descriptor)
            continue
        owner = _owner(descriptor)
        if owner.get("host", socket.gethostname()) != socket.gethostname():
            os.close(descriptor)
            raise InputError(
                f"a run on host {owner['host']} (process {owner.get('pid', '?')}) has this folder",
                where=str(path.parent),
                remedy=f"if that run is dead, delete {path}",
            )
        return descriptor


def _is_still_there(path: Path, descriptor: int) -> bool:
    """Whether the file just locked is still the one of that name: its last owner deletes it on leaving."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _owner(descriptor: int) -> dict:
    try:
        owner = json.loads(os.pread(descriptor, 4096, 0))
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}
