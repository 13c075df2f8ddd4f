"""What the next run will take, as the runs so far tell."""

from __future__ import annotations

import time
from collections.abc import Hashable

from skinrender.engine.timed import Linear

REFERENCE_SHARE = 0.4
"""Of a time budget."""
PROBES = (10_000, 100_000)
"""Photons of the short runs that tell the pace when nothing else does."""


class Pace:
    """Seconds by photons, from what was measured."""

    def __init__(self) -> None:
        self._seconds: dict[int, float] = {}

    def add(self, photons: int, seconds: float) -> None:
        """A run of so many photons took so long."""
        self._seconds[photons] = seconds

    def __bool__(self) -> bool:
        return bool(self._seconds)

    @property
    def law(self) -> Linear:
        """Through the two largest runs; else through the largest and the origin, which rather overstates larger ones."""
        largest = sorted(self._seconds)[-2:]
        first, last = self._seconds[largest[0]], self._seconds[largest[-1]]
        if last <= first:
            return Linear(0.0, last / largest[-1])
        each = (last - first) / (largest[-1] - largest[0])
        return Linear(max(0.0, last - each * largest[-1]), each)

    def photons_within(self, seconds: float) -> float:
        """How many photons so many seconds allow."""
        law = self.law
        return max(0.0, seconds - law.start) / law.each


class Budget:
    """A time budget, or none.

    Parameters
    ----------
    seconds : for everything; None: no limit.
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self.paces: dict[Hashable, Pace] = {}
        self._began = time.perf_counter()

    @property
    def is_limited(self) -> bool:
        return self.seconds is not None

    @property
    def used(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self._began

    def pace(self, of: Hashable) -> Pace:
        """The pace of a kind of run."""
        return self.paces.setdefault(of, Pace())

    def allows(self, of: Hashable, photons: int) -> bool:
        """Whether a run of so many photons will probably end in time; the first of its kind always may."""
        if self.seconds is None or not self.pace(of):
            return True
        return self.used + self.pace(of).law.at(photons) <= self.seconds

    def reference_photons(self, of: Hashable, wanted: int, least: int, sharers: int) -> int:
        """Photons of a reference that leaves enough time for the runs: `wanted`, or fewer, but not below `least`."""
        if self.seconds is None:
            return wanted
        fits = 2 * self.pace(of).photons_within(0.5 * REFERENCE_SHARE * self.seconds / sharers)
        return int(min(wanted, max(least, fits)))
