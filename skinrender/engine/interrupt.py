"""Ctrl-C and SIGTERM: what is under way ends cleanly, what is finished is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted(KeyboardInterrupt):
    """The run was stopped from outside; what was finished is kept (exit code 130)."""


class Interrupt:
    """Remembers that a signal came; `check` raises it at a place where nothing is half done."""

    def __init__(self) -> None:
        self.requested = False

    def request(self, *_: object) -> None:
        """Signal handler: the first signal asks, the second one insists."""
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True

    def check(self) -> None:
        """Raise `Interrupted` if a signal came."""
        if self.requested:
            raise Interrupted("interrupted")


@contextmanager
def listen() -> Iterator[Interrupt]:
    """Turn SIGINT and SIGTERM into a request while the block runs (main thread only; elsewhere nothing is heard)."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    before = {number: signal.signal(number, interrupt.request) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
