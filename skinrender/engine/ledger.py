"""The books of a run: counts of the rounds done so far, in order, and the errors that follow from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from skinrender.errors import RunError
from skinrender.photonmap.store import RoundCounts
from skinrender.transport import tally


class Batches:
    """Standard error of a mean from independent batches of equal size, updated one by one (Welford 1962)."""

    def __init__(self) -> None:
        self._count, self._mean, self._squares = 0, 0.0, 0.0

    def add(self, values: np.ndarray) -> None:
        self._count += 1
        step = values - self._mean
        self._mean = self._mean + step / self._count
        self._squares = self._squares + step * (values - self._mean)

    @property
    def stderr(self) -> np.ndarray:
        """Standard error of the mean; not a number with fewer than two batches."""
        if self._count < 2:
            return np.full(np.shape(self._mean), np.nan)
        return np.sqrt(self._squares / (self._count * (self._count - 1)))


class Ledger:
    """Rounds done, in order; B bands, T tally columns.

    Parameters
    ----------
    power_per_band : (B,) W aimed at the patch; weighs the bands in totals.
    """

    def __init__(self, power_per_band: Sequence[float]) -> None:
        self.power_per_band = np.asarray(power_per_band, np.float64)
        self.rounds: list[RoundCounts] = []
        self.stored = 0
        self.counts: np.ndarray | None = None
        self._per_band, self._total = Batches(), Batches()

    def add(self, walked: Any) -> None:
        """Enter the next round, anything with the members of `store.RoundCounts`; only these are kept.

        Raises `RunError` if its photons do not add up.
        """
        check_counts(walked)
        counts = RoundCounts(walked.index, walked.emitted, walked.stored_per_band, walked.tallies)
        fractions = _fractions(counts.tallies)
        self.counts = counts.tallies.copy() if self.counts is None else self.counts + counts.tallies
        self.stored += counts.stored
        self.rounds.append(counts)
        self._per_band.add(fractions)
        self._total.add(self._weights(counts.tallies) @ fractions)

    @property
    def fractions(self) -> np.ndarray:
        """(B, T) tallies per history; 0 in bands without any."""
        return _fractions(self.counts)

    @property
    def fractions_stderr(self) -> np.ndarray:
        """(B, T) standard errors of `fractions`."""
        return self._per_band.stderr

    @property
    def total(self) -> np.ndarray:
        """(T,) fractions of all bands, weighted by their power."""
        return self._weights(self.counts) @ self.fractions

    @property
    def total_stderr(self) -> np.ndarray:
        """(T,) standard errors of `total`."""
        return self._total.stderr

    def _weights(self, tallies: np.ndarray) -> np.ndarray:
        used = tallies[:, tally.EMITTED] > 0
        power = np.where(used, self.power_per_band, 0.0)
        if not power.any():
            power = used.astype(np.float64)
        power = power / power.max()
        return power / math.fsum(power)


def check_counts(counts: Any) -> None:
    """Raise `RunError` unless every photon of the round is known to have left or to have been absorbed."""
    tallies, emitted = counts.tallies, counts.tallies[:, tally.EMITTED]
    layers = (tallies.shape[1] - tally.PER_LAYER) // 2
    ended = tallies[:, [tally.REFLECTED, tally.TRANSMITTED, tally.SIDES]].sum(axis=1)
    ended = ended + tallies[:, tally.absorbed(layers)].sum(axis=1)
    if tallies[:, tally.LOST].any() or (ended != emitted).any() or (emitted != counts.emitted).any():
        lost = int((counts.emitted - ended).sum())
        raise RunError(f"round {counts.index}: {lost} photons are unaccounted for; this is a fault of skinrender")


def _fractions(tallies: np.ndarray) -> np.ndarray:
    emitted = tallies[:, tally.EMITTED, None]
    return np.divide(tallies, emitted, out=np.zeros(tallies.shape), where=emitted > 0)
