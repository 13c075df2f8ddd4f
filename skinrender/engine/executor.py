"""The process pool: rounds are handed out ahead of need and come back in order.

The only module that knows how work is spread. It asks for nothing but `concurrent.futures.Executor`, so a cluster's
executor can take the pool's place. It imports no numpy: a worker sets the number of threads before anything heavy
loads.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for
from typing import TypeVar

from skinrender.errors import InputError, RunError

Result = TypeVar("Result")
Work = Callable[[int], Result]

POLL_SECONDS = 0.2
DEATHS_IN_A_ROW = 3
MOST_WORKERS, MOST_WORKERS_PER_CORE = 32, 4
ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

UNGUARDED = (
    "a script that starts processes is imported by each of them: start the run under `if __name__ == '__main__':`"
)

_enough = None


def leave_unguarded_script() -> None:
    """End this process if it is a worker that is still importing the script it belongs to, and so starts the run
    again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)  # the run that started this worker tells why


def in_order(
    work: Work,
    indices: Iterable[int],
    *,
    workers: int = 1,
    check: Callable[[], None] = lambda: None,
    open_executor: Callable[[], Executor] | None = None,
) -> Iterator[Result]:
    """Yield ``work(index)`` for each index, in the order of `indices`.

    Parameters
    ----------
    work : picklable function of the index; may be called again for an index whose worker died.
    indices : may be endless: only as many are taken as there is work for.
    workers : number of processes; 1 works in this one.
    check : called often in this process; what it raises ends the run.
    open_executor : makes the executor to use in place of a process pool.

    Close the iterator (`contextlib.closing`) to drop what was handed out ahead.
    Raises `RunError` if workers keep dying, `InputError` if they cannot even begin.
    """
    leave_unguarded_script()
    most = max(MOST_WORKERS, MOST_WORKERS_PER_CORE * (os.cpu_count() or 1))
    if workers < 1 or workers > most and open_executor is None:
        raise InputError(f"{workers} workers are not possible", where="--workers", remedy=f"use 1 to {most}")
    if workers == 1 and open_executor is None:
        for index in indices:
            check()
            yield work(index)
        check()
        return
    handout = _Handout(work, iter(indices), workers, open_executor)
    try:
        while handout.hand_out():
            yield handout.collect(check)
    finally:
        handout.dismiss()


class _Handout:
    """An executor, the rounds in its hands (oldest first), and what to do when it breaks."""

    def __init__(self, work: Work, indices: Iterator[int], workers: int, open_executor) -> None:
        self._work = work
        self._indices = indices
        self._ahead = workers + 1
        self._tell_enough = self._begun = None
        if open_executor is None:
            context = multiprocessing.get_context("spawn")
            enough, self._tell_enough = context.Pipe(duplex=False)
            self._begun, tell_begun = context.Pipe(duplex=False)
            open_executor = _pool_opener(workers, enough, tell_begun)
        self._open_executor = open_executor
        self._executor = open_executor()
        self._pending: deque[tuple[int, Future]] = deque()
        self._deaths = 0

    def hand_out(self) -> bool:
        """Fill the look-ahead; whether anything is to be waited for."""
        while len(self._pending) < self._ahead:
            index = next(self._indices, None)
            if index is None:
                break
            self._pending.append((index, self._submit(index)))
        return bool(self._pending)

    def collect(self, check: Callable[[], None]) -> Result:
        """The oldest round's result, done again as long as workers die over it."""
        while True:
            future = self._pending[0][1]
            while not future.done():
                check()
                wait([future], timeout=POLL_SECONDS)
            check()
            try:
                result = future.result()
            except BrokenExecutor as error:
                self._replace(error)
                continue
            self._deaths = 0
            self._pending.popleft()
            return result

    def dismiss(self) -> None:
        """Drop what has not begun, wait for what has."""
        if self._tell_enough is None:
            self._close()
            return
        # nothing is cancelled: workers pass by what is left, and the pool of Python 3.11.2 waits forever for cancelled futures
        self._tell_enough.send_bytes(b"enough")
        self._executor.shutdown(wait=True)

    def _close(self) -> None:
        """Cancelled one by one: not every executor can cancel what is left when it shuts down."""
        for _, future in self._pending:
            future.cancel()
        self._executor.shutdown(wait=True)

    def _submit(self, index: int) -> Future:
        try:
            with _interrupts_held():
                return self._executor.submit(_call, self._work, index)
        except BrokenExecutor as error:
            broken: Future = Future()
            broken.set_exception(error)
            return broken

    def _replace(self, error: BrokenExecutor) -> None:
        if self._begun is not None and not self._begun.poll():
            raise InputError(
                "worker processes end before they begin", where="workers", remedy=f"{UNGUARDED}, or use 1"
            ) from error
        self._deaths += 1
        if self._deaths > DEATHS_IN_A_ROW:
            raise RunError(
                f"worker processes died {self._deaths} times in a row (out of memory?)\n"
                "  try fewer --workers; what is finished is kept: go on with --resume"
            ) from error
        self._close()
        self._executor = self._open_executor()
        self._pending = deque(
            (index, future if _has_result(future) else self._submit(index)) for index, future in self._pending
        )


def _has_result(future: Future) -> bool:
    return future.done() and not future.cancelled() and not isinstance(future.exception(), BrokenExecutor)


def _pool_opener(workers: int, enough, tell_begun) -> Callable[[], Executor]:
    def open_pool() -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(
            workers, mp_context=context, initializer=_begin_worker, initargs=(enough, tell_begun)
        )

    return open_pool


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT meanwhile: a process started here inherits that and leaves Ctrl-C to its parent from the outset."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker(enough, tell_begun) -> None:
    """One thread for every library, deaf to Ctrl-C, and gone when the parent is gone.

    `enough` is a pipe in which a message appears, and stays, when the run is over: it has no lock that a killed worker
    could take with it. Into `tell_begun` goes that this worker has come so far.
    """
    global _enough
    _enough = enough
    tell_begun.send_bytes(b"begun")
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    wait_for([multiprocessing.parent_process().sentinel])
    os._exit(1)


def _call(work: Work, index: int) -> Result | None:
    """Run in the worker; rounds still queued when the run is over are passed by."""
    if _enough is not None and _enough.poll():
        return None
    return work(index)
