"""Judges of cases: z-scores against closed forms, and between the two sides of a limit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy import stats

from skinrender.analysis.slab_stats import FEW, Z_BOUND, fraction
from skinrender.analysis.stability_case import METHODS, Judge, Measure, Outcome
from skinrender.engine.summary import FRACTIONS
from skinrender.skin.regions import regions_of
from skinrender.transport import tally

_UNLIKELY = 40.0
"""z of what cannot be; a number, so that a table can show it."""


def judged(*judges: Judge) -> Judge:
    """Several judges of the same outcomes."""
    return lambda outcomes: [measure for judge in judges for measure in judge(outcomes)]


def expects(*sides: dict[str, float], accuracy: float = 0.0) -> Judge:
    """Fractions of the light of each scene: names of the trace summary's, or ``absorbed``; expected values.

    What is expected to be exactly 0 or 1 must be so in counts.
    """

    def judge(outcomes: Sequence[Outcome]) -> Iterable[Measure]:
        found = [
            _bounded(fraction("", name, value, accuracy, outcome.count(_column(outcome, name)), outcome.light.emitted).z)
            for outcome, expected in zip(outcomes, sides, strict=True)
            for name, value in expected.items()
        ]
        names = dict.fromkeys(name for expected in sides for name in expected)
        yield _worst("z of " + ", ".join(names), found)

    return judge


def shows(*radiances: float, methods: Sequence[str] = METHODS) -> Judge:
    """Mean radiance of each scene's pictures, W mm^-2 sr^-1."""

    def judge(outcomes: Sequence[Outcome]) -> Iterable[Measure]:
        for method in methods:
            found = []
            for outcome, expected in zip(outcomes, radiances, strict=True):
                summary = outcome.pictures[method].summary
                found.append(_z(summary.mean_radiance - expected, summary.mean_radiance_stderr))
            yield _worst(f"z of the {method} radiance", found)

    return judge


def alike(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """The light of all scenes is that of the first: every fate of a photon, by layer."""
    first = outcomes[0]
    layers = [len(outcome.light.layer_name) for outcome in outcomes]
    fates = [tally.REFLECTED, tally.SPECULAR, tally.TRANSMITTED, tally.SIDES, "absorbed"]
    if len(set(layers)) == 1:
        fates += range(tally.PER_LAYER, tally.PER_LAYER + layers[0])
    found = []
    for other in outcomes[1:]:
        for fate in fates:
            column, its = (_column(one, fate) if isinstance(fate, str) else fate for one in (first, other))
            counts = first.count(column), other.count(its)
            found.append(same_share(*counts, first.light.emitted, other.light.emitted))
    yield _worst("z of R, T, A between the sides", found)


def alike_in_picture(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """The mean radiance of all scenes is that of the first."""
    for method in outcomes[0].pictures:
        one, *others = (outcome.pictures[method].summary for outcome in outcomes)
        found = [
            _z(one.mean_radiance - other.mean_radiance, math.hypot(one.mean_radiance_stderr, other.mean_radiance_stderr))
            for other in others
        ]
        yield _worst(f"z of the {method} radiance between the sides", found)


def pictures_agree(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Beam and point show the same mean radiance; they share photons, so the standard error is on the safe side."""
    found = []
    for outcome in outcomes:
        one, other = (outcome.pictures[method].summary for method in ("beam", "point"))
        found.append(
            _z(one.mean_radiance - other.mean_radiance, math.hypot(one.mean_radiance_stderr, other.mean_radiance_stderr))
        )
    yield _worst("z of beam against point", found)


def nothing_scattered(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """An empty map, and pictures without light from inside."""
    yield Measure("photons stored", float(max(len(outcome.photons) for outcome in outcomes)), 0.0)
    images = [picture.image for outcome in outcomes for picture in outcome.pictures.values()]
    yield Measure("radiance from inside", float(max(np.max(image.multiple_Y + image.single_Y) for image in images)), 0.0)


def reflects_as_its_index(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Light that a flat surface reflects at once, of upright light in equal histories a band."""
    found = []
    for outcome in outcomes:
        index = regions_of(outcome.volume).index[1]
        expected = float(np.mean(((index - 1.0) / (index + 1.0)) ** 2))
        found.append(_bounded(fraction("", "", expected, 0.0, outcome.count(tally.SPECULAR), outcome.light.emitted).z))
    yield _worst("z of specular", found)


def same_share(a: int, b: int, histories_a: int, histories_b: int) -> float:
    """z of two counts of the same fate among so many histories; exact given their sum where they are few."""
    total, share = a + b, histories_a / (histories_a + histories_b)
    if total in (0, histories_a + histories_b):
        return 0.0
    if min(total, histories_a + histories_b - total) < FEW:
        if total > FEW:
            a, total = histories_a - a, histories_a + histories_b - total
        p = stats.binomtest(a, total, share).pvalue
        return float(stats.norm.isf(0.5 * p))
    pooled = total / (histories_a + histories_b)
    variance = pooled * (1.0 - pooled) * (1.0 / histories_a + 1.0 / histories_b)
    return (a / histories_a - b / histories_b) / math.sqrt(variance)


def _column(outcome: Outcome, name: str) -> int | slice:
    layers = len(outcome.light.layer_name)
    return tally.absorbed(layers) if name == "absorbed" else FRACTIONS[name]


def _z(difference: float, stderr: float) -> float:
    """z of a difference whose standard error comes from about 20 batches, as that of a normal distribution."""
    if difference == 0.0:
        return 0.0
    p = float(stats.t.sf(abs(difference) / stderr, 19)) if stderr > 0.0 else 0.0
    return float(stats.norm.isf(p)) if p > 0.0 else _UNLIKELY


def _bounded(z: float) -> float:
    return min(abs(z), _UNLIKELY)


def _worst(quantity: str, found: Sequence[float]) -> Measure:
    return Measure(quantity, max(abs(z) for z in found), Z_BOUND)
