"""Work beside other work, on a thread of its own: kernels release the interpreter lock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


def beside(work: Callable[[], Result]) -> Callable[[], Result]:
    """Begin some work; the function that waits for what it gives, or raises what it raised.

    The thread is a daemon, unlike an executor's: a run that is interrupted need not wait for what nobody will use.
    """
    future: Future = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # whatever it is, it belongs to who waits
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future.result
