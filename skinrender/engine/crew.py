"""Who walks the rounds of a run, and the progress shown meanwhile."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass

from tqdm import tqdm

from skinrender.engine.interrupt import Interrupt
from skinrender.engine.ledger import Ledger
from skinrender.engine.rounds import rounds_until
from skinrender.engine.stop import Stop
from skinrender.engine.work import WalkRound

WORTH_A_POOL = 1e7
"""Photons below which starting processes takes longer than it saves."""


def is_worth_a_pool(stored: float) -> bool:
    """Whether a run that stores so many photons is shared among processes when nobody says how many."""
    return stored >= WORTH_A_POOL


@dataclass(frozen=True, eq=False)
class Crew:
    """Who does the work.

    Parameters
    ----------
    workers : processes; None lets the size of the run decide.
    progress : show a progress bar when on a terminal.
    open_executor : makes another `concurrent.futures.Executor` than the process pool, say a cluster's.
    """

    workers: int | None = None
    progress: bool = True
    open_executor: Callable[[], Executor] | None = None

    def workers_for(self, stored: float) -> int:
        """Number of processes for a run that stores `stored` photons."""
        if self.workers is not None:
            return self.workers
        return (os.cpu_count() or 1) if is_worth_a_pool(stored) else 1

    def walk(
        self,
        work: WalkRound,
        indices: Iterable[int],
        ledger: Ledger,
        stop: Stop,
        interrupt: Interrupt,
        expected: int | None = None,
    ) -> None:
        """Walk rounds into `ledger` until `stop` is met or the indices end.

        Parameters
        ----------
        work, indices, ledger, stop : see `rounds.rounds_until`.
        interrupt : listened to all the time.
        expected : photons at which the bar is full, if that is known.
        """
        rounds = rounds_until(
            stop,
            work,
            indices,
            ledger,
            workers=self.workers_for(expected or 0),
            check=interrupt.check,
            open_executor=self.open_executor,
        )
        hide = None if self.progress else True
        with tqdm(total=expected, unit=" photons", unit_scale=True, disable=hide, desc="trace", leave=False) as bar:
            for counts in rounds:
                bar.update(counts.stored if work.folder is not None else int(counts.emitted.sum()))
