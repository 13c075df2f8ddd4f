"""Ctrl-C and SIGTERM: what is under way ends cleanly, what is finished is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Interrupted(KeyboardInterrupt):
    """The run was stopped from outside; what was finished is kept (exit code 130).

    A class of its own also for CPython's sake: where a plain KeyboardInterrupt passed through an `exec` of text, the
    interpreter ends by SIGINT whatever exit code it is given.
    """


class Interrupt:
    """Remembers that a signal came; `check` raises it at a place where nothing is half done."""

    def __init__(self) -> None:
        self.requested = False

    def request(self, *_: object) -> None:
        """Signal handler: the first signal asks, the second one insists."""
        if self.requested:
            raise Interrupted
        self.requested = True

    def stop(self, *_: object) -> None:
        """Signal handler: the first signal insists."""
        self.requested = True
        raise Interrupted

    def check(self) -> None:
        """Raise `Interrupted` if a signal came."""
        if self.requested:
            raise Interrupted("interrupted")


@contextmanager
def listen() -> Iterator[Interrupt]:
    """Turn SIGINT and SIGTERM into a request while the block runs; one that it never looked at is raised at its end."""
    interrupt = Interrupt()
    with handled_by(interrupt.request):
        yield interrupt
    interrupt.check()


@contextmanager
def stopped_at_once() -> Iterator[None]:
    """Let SIGINT and SIGTERM raise `Interrupted` wherever the program is while the block runs.

    Whatever error comes of that is an interruption too: the import of a compiled module turns it into an `ImportError`.
    """
    interrupt = Interrupt()
    with handled_by(interrupt.stop):
        try:
            yield
        except Exception as error:
            if interrupt.requested:
                raise Interrupted from error
            raise


@contextmanager
def handled_by(handler: Callable[..., None]) -> Iterator[None]:
    """Let `handler` hear SIGINT and SIGTERM while the block runs (main thread only; elsewhere nothing is heard).

    A signal that the caller wants ignored, as shells do for SIGINT in background jobs, stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
