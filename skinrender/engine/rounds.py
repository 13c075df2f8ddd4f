"""Rounds: the unit that is walked, written, resumed and averaged over.

A round is a fixed number of histories of every band. Its size follows from the scene and the wanted number of photons
alone: a pilot with a seed of its own counts how many photons a history stores.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinrender.engine.executor import in_order
from skinrender.engine.ledger import Ledger
from skinrender.engine.stop import MIN_ROUNDS, Stop
from skinrender.film.color import color_sensitivity

PILOT_SEED = 0x70696C6F74
PILOT_ROUNDS = 16
PILOT_HISTORIES = 1024
PILOT_PROBE = 64
"""Part of a pilot's round that is walked first, lest the round not fit into memory."""
PILOT_STORED_ENOUGH = 1 << 22
USUAL_ROUNDS = 40
LEAST_SHARE = 0.2
"""Histories of any lit band, relative to the band that has most."""
ROUND_STORED_MAX = 1 << 23
"""Bounds a worker's memory: 143 MB of photons."""
ROUND_HISTORIES_MAX = 1 << 24
SIGMAS = 6.0


@dataclass(frozen=True, eq=False)
class Pilot:
    """Photons stored per history, measured.

    Parameters
    ----------
    stored : (B,) mean in each band.
    relative_stderr : of the mean over the bands.
    relative_spread : standard deviation of one history's count, over the mean.
    """

    stored: np.ndarray
    relative_stderr: float
    relative_spread: float


@dataclass(frozen=True, eq=False)
class RoundPlan:
    """Size and expected number of rounds.

    Parameters
    ----------
    histories : (B,) i8, in each round.
    stored_wanted : photons; 0 when the scene stores none.
    stored_per_round : expected.
    stored_stderr : relative standard error of that expectation.
    round_spread : relative standard deviation of one round about it.
    """

    histories: np.ndarray
    stored_wanted: int
    stored_per_round: float
    stored_stderr: float
    round_spread: float

    @property
    def rounds_expected(self) -> int:
        """Rounds that the run will probably take."""
        if not self.stored_wanted:
            return MIN_ROUNDS
        return max(MIN_ROUNDS, math.ceil(self.stored_wanted / self.stored_per_round))

    @property
    def rounds_enough(self) -> int:
        """Rounds that will hold the wanted photons all but surely; what shards walk together."""
        if not self.stored_wanted:
            return MIN_ROUNDS
        doubt = SIGMAS * math.hypot(self.stored_stderr, self.round_spread / math.sqrt(self.rounds_expected))
        surely = self.stored_per_round * (1 - min(doubt, 0.5))
        return max(MIN_ROUNDS, math.ceil(self.stored_wanted / surely))

    @property
    def stored_expected(self) -> float:
        """Photons in the finished map."""
        return self.rounds_expected * self.stored_per_round

    @property
    def emitted_expected(self) -> int:
        """Histories of all rounds."""
        return self.rounds_expected * int(self.histories.sum())


def run_pilot(photon_pass: Any, share: np.ndarray) -> Pilot:
    """Walk a few small rounds of a pass that was made with `PILOT_SEED`.

    Parameters
    ----------
    photon_pass : a `photon_pass.PhotonPass`.
    share : (B,) histories of each band relative to the largest; 0 leaves a band out.
    """
    histories = np.ceil(share * max(1, PILOT_HISTORIES // len(share))).astype(np.int64)
    few = np.ceil(histories / PILOT_PROBE).astype(np.int64)
    probed = float(photon_pass.walk(PILOT_ROUNDS, few, True).stored_per_band @ (histories / np.maximum(few, 1)))
    if probed > PILOT_STORED_ENOUGH:  # clear thick media scatter light a hundred thousand times
        histories = np.ceil(histories * (PILOT_STORED_ENOUGH / probed)).astype(np.int64)
    stored = []
    for index in range(PILOT_ROUNDS):
        stored.append(photon_pass.walk(index, histories, True).stored_per_band)
        if index >= 3 and np.sum(stored) > PILOT_STORED_ENOUGH:
            break
    per_round = np.sum(stored, axis=1)
    mean = per_round.mean()
    spread = per_round.std(ddof=1) / mean if mean else 0.0
    return Pilot(
        np.divide(np.mean(stored, axis=0), histories, out=np.zeros(len(share)), where=histories > 0),
        float(spread / math.sqrt(len(stored))),
        float(spread * math.sqrt(histories.sum())),
    )


def plan_rounds(pilot: Pilot, share: np.ndarray, stored_wanted: int) -> RoundPlan:
    """Choose the histories of a round so that about `USUAL_ROUNDS` of them store `stored_wanted` photons.

    Larger runs take more rounds, not larger ones: a round's photons stay below `ROUND_STORED_MAX`.
    """
    stored_by_share = float(pilot.stored @ share)
    if stored_by_share == 0:  # the fractions of the light are all that the run is for
        stored_wanted, scale = 0, PILOT_HISTORIES / share.sum()
    else:
        wanted_per_round = min(stored_wanted / USUAL_ROUNDS, ROUND_STORED_MAX)
        scale = min(wanted_per_round / stored_by_share if stored_wanted else 1.0, ROUND_HISTORIES_MAX / share.sum())
    histories = np.where(share > 0, np.maximum(1, np.ceil(scale * share)), 0).astype(np.int64)
    return RoundPlan(
        histories=histories,
        stored_wanted=stored_wanted,
        stored_per_round=float(pilot.stored @ histories),
        stored_stderr=pilot.relative_stderr,
        round_spread=pilot.relative_spread / math.sqrt(histories.sum()),
    )


def uniform_share(power_per_band: np.ndarray) -> np.ndarray:
    """As many histories in every band that carries power (paper, section 7.1: wavelengths drawn uniformly)."""
    power = np.asarray(power_per_band)
    return (power > 0).astype(np.float64) if (power > 0).any() else np.ones(len(power))


def visible_share(power_per_band: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """More histories in the bands by which a picture has its color, and some in all.

    The root of a band's `color_sensitivity`, at least `LEAST_SHARE`. Variance of luminance and of color falls to 0.67 in the
    same time; in proportion to the sensitivity itself it did to 0.64, within the error of two seeds the same, but 400 nm had more noise.
    """
    sensitivity = color_sensitivity(wavelength_nm, power_per_band)
    root = np.sqrt(sensitivity / sensitivity.max())
    return uniform_share(power_per_band) * np.maximum(root, LEAST_SHARE)


def rounds_until(
    stop: Stop,
    work: Callable[[int], Any],
    indices: Iterable[int],
    ledger: Ledger,
    *,
    workers: int = 1,
    check: Callable[[], None] = lambda: None,
    open_executor: Callable[[], Executor] | None = None,
) -> Iterator[Any]:
    """Do rounds in order, enter each into the ledger, yield it, and end after the first that meets the stop rule.

    Parameters
    ----------
    stop : consulted after each round.
    work : picklable; round index -> anything with the members of `store.RoundCounts`.
    indices : of the rounds, usually `itertools.count()`.
    ledger : receives the rounds.
    workers, check, open_executor : see `executor.in_order`.
    """
    with closing(in_order(work, indices, workers=workers, check=check, open_executor=open_executor)) as results:
        for result in results:
            ledger.add(result)
            yield result
            if stop.met(ledger):
                return
