"""How far a count is from what is expected, in standard errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

Z_BOUND = 4.0
FEW = 25
"""Expected counts below which a normal distribution would not do."""


@dataclass(frozen=True)
class Result:
    """One quantity of one record: expected, measured, standard error of the difference, and their z."""

    id: str
    quantity: str
    expected: float
    got: float
    stderr: float
    z: float

    @property
    def ok(self) -> bool:
        return abs(self.z) < Z_BOUND

    def as_json(self) -> dict[str, Any]:
        """As ``skinrender check --json`` lists it."""
        return {**vars(self), "ok": self.ok}


def fraction(
    id: str, quantity: str, expected: float, accuracy: float, count: int, histories: int, *, unit: float = 1.0
) -> Result:
    """Score the share of the histories that met some fate.

    The standard error is the binomial one *under the expected value*, the truth's accuracy in quadrature. Where fewer
    than `FEW` histories are expected to meet the fate, or to be spared, z is that of the exact binomial tail. What is
    expected never or always must be so.

    Parameters
    ----------
    expected, accuracy : of the share, and the truth's own standard error.
    count, histories : counted, of so many.
    unit : share that makes one of the quantity.
    """
    got = count / histories
    stderr = math.hypot(math.sqrt(expected * (1.0 - expected) / histories), accuracy)
    if expected in (0.0, 1.0):
        stderr, z = 0.0, 0.0 if got == expected else math.copysign(math.inf, got - expected)
    elif histories * expected < FEW:
        z = _tail_z(count, histories, expected)
    elif histories * (1.0 - expected) < FEW:
        z = -_tail_z(histories - count, histories, 1.0 - expected)
    else:
        z = (got - expected) / stderr
    return _result(id, quantity, expected, got, stderr, z, unit)


def events(
    id: str, quantity: str, expected: float, accuracy: float, got: float, stderr: float, histories: int, *,
    burst: float = 1.0, unit: float = 1.0,
) -> Result:  # fmt: skip
    """Score a number of events per history, of which one history may have many.

    The variance comes from the rounds; that of rare events is proportional to their number, which is how it is taken
    to the expected value (rounds without any would otherwise claim certainty). Events of one history come in bursts:
    n events tell as much as n / (variance / mean) independent ones, and where fewer than `FEW` of these are expected,
    z is that of the binomial tail of bursts.

    Parameters
    ----------
    expected, accuracy : of events per history, and the truth's own standard error.
    got, stderr : measured per history, standard error from the rounds.
    histories : walked.
    burst : events of a history that has any, for when none was seen.
    unit : events per history that make one of the quantity.
    """
    if expected == 0.0:
        return _result(id, quantity, 0.0, got, 0.0, 0.0 if got == 0.0 else math.inf, unit)
    if got > 0.0 and stderr > 0.0:
        burst = max(1.0, histories * stderr**2 / got)
        noise = stderr * math.sqrt(expected / got)
    else:
        noise = math.sqrt(expected * burst / histories)
    total = math.hypot(noise, accuracy)
    if histories * expected / burst < FEW:
        z = _tail_z(round(histories * got / burst), histories, min(1.0, expected / burst))
    else:
        z = (got - expected) / total
    return _result(id, quantity, expected, got, total, z, unit)


def _result(id: str, quantity: str, expected: float, got: float, stderr: float, z: float, unit: float) -> Result:
    return Result(id, quantity, float(expected / unit), float(got / unit), float(stderr / unit), float(z) + 0.0)


def _tail_z(count: int, trials: int, probability: float) -> float:
    """Normal score of the binomial probability of a count at least as far from the mean, signed."""
    above = count > trials * probability
    tail = stats.binom.sf(count - 1, trials, probability) if above else stats.binom.cdf(count, trials, probability)
    z = float(stats.norm.isf(min(float(tail), 0.5)))
    return z if above else -z


def distribution(z: Sequence[float]) -> dict[str, float | int | None]:
    """Whether independent z are standard normal: the sum of their squares (chi-square) and Kolmogorov-Smirnov.

    Returns
    -------
    dict : ``count``, ``mean``, ``sum_z2``, ``p_chi2`` (two-sided) and ``p_ks``; None where there are fewer than two.
    """
    z = np.asarray([value for value in z if math.isfinite(value)])
    if z.size < 2:
        return {"count": int(z.size), "mean": None, "sum_z2": None, "p_chi2": None, "p_ks": None}
    sum_z2 = float(z @ z)
    p_chi2 = 2.0 * min(stats.chi2.sf(sum_z2, z.size), stats.chi2.cdf(sum_z2, z.size))
    p_ks = float(stats.kstest(z, "norm").pvalue)
    return {"count": int(z.size), "mean": float(z.mean()), "sum_z2": sum_z2, "p_chi2": float(min(1.0, p_chi2)), "p_ks": p_ks}
