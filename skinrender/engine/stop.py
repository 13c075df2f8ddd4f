"""When a run is complete: rules consulted after each round, in order."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from skinrender.engine.ledger import Ledger
from skinrender.transport import tally

MIN_ROUNDS = 32
"""Batches for a standard error."""


class Stop(Protocol):
    """A stop rule."""

    def met(self, ledger: Ledger) -> bool:
        """Whether the round entered last is the last one needed."""


@dataclass(frozen=True)
class Never:
    """The run ends with its indices."""

    def met(self, ledger: Ledger) -> bool:
        return False


@dataclass(frozen=True)
class StoredCount:
    """Enough photons are stored."""

    stored: int

    def met(self, ledger: Ledger) -> bool:
        return len(ledger.rounds) >= MIN_ROUNDS and ledger.stored >= self.stored


@dataclass(frozen=True)
class StandardError:
    """The totals are known well enough.

    Parameters
    ----------
    fraction : largest standard error of the reflected, transmitted and absorbed fractions.
    events_relative : the same for the scattering events in each layer, relative, where there is at least one a photon.
    every_band : ask the fractions of every band for it, not only their total.
    """

    fraction: float
    events_relative: float | None = None
    every_band: bool = False

    def met(self, ledger: Ledger) -> bool:
        if len(ledger.rounds) < MIN_ROUNDS:
            return False
        values, errors = ledger.total[None], ledger.total_stderr[None]
        if self.every_band:
            values, errors = ledger.fractions, ledger.fractions_stderr
        layers = (values.shape[1] - tally.PER_LAYER) // 2
        ways_out = errors[:, [tally.REFLECTED, tally.TRANSMITTED, tally.SIDES]]
        if max(ways_out.max(), errors[:, tally.absorbed(layers)].max(initial=0.0)) > self.fraction:
            return False
        if self.events_relative is None:
            return True
        events, error = values[:, tally.scattered(layers)], errors[:, tally.scattered(layers)]
        return bool(np.all((events < 1) | (error <= self.events_relative * events)))


def described(stop: Stop) -> dict[str, Any]:
    """A rule in JSON, for provenance."""
    return {"rule": type(stop).__name__} | asdict(stop)
