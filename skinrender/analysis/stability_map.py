"""Extremes of the photon map: none, one, all at a point, any gather count, any power of the light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skinrender.analysis.closed_forms import half_space_radiance
from skinrender.analysis.stability_case import Case, Measure, Outcome, Refused
from skinrender.analysis.stability_judges import alike, alike_in_picture, judged, nothing_scattered, shows
from skinrender.analysis.stability_scenes import NORMAL, PENCIL, half_space, layer, slab

ALBEDO = 0.5
TISSUE = half_space(ALBEDO, 10.0, 60.0)
SEEN = half_space_radiance(ALBEDO, 1.0)
POWERS = (1.0, 1e-30, 1e30)
SAME = {"seed": 1}


def lit(power: float, **sections) -> dict:
    light = {**NORMAL, "irradiance_W_per_mm2": power}
    return slab(layer(1.0, 0.5, 10.0, 0.5, 1.4), light=light, camera={"cross_polarized": False}, **sections)


def in_proportion(outcomes: Sequence[Outcome]) -> Iterator[Measure]:
    """Radiance, noise and irradiance scale with the power of the light, to float32's rounding; the photons are the same."""
    for method in outcomes[0].pictures:
        first, *others = (outcome.pictures[method].image for outcome in outcomes)
        worst = 0.0
        for power, other in zip(POWERS[1:], others, strict=True):
            for part in ("radiance", "stderr_Y", "multiple_Y", "single_Y", "surface_Y", "irradiance"):
                expected = power * getattr(first, part).astype(float)
                worst = max(worst, float(np.max(np.abs(getattr(other, part) - expected) / np.maximum(expected, 1e-300))))
        yield Measure(f"relative deviation, {method}", worst, 1e-6)


CASES = (
    Case(
        "gather counts of 1, of 1e9, and none",
        "a kernel without photons or wider than the patch; count larger than the map",
        [slab(TISSUE, estimate={"gather_count": count}) for count in (1, 10**9, None)],
        judged(shows(*[SEEN] * 3), alike_in_picture),
    ),
    Case(
        "a map of one wanted photon",
        "rounds without photons; batches without spread",
        [slab(TISSUE, photons={"stored": 1})],
        lambda outcomes: [],
    ),
    Case(
        "no light enters, or none is scattered",
        "an empty map",
        [slab(layer(1.0, 5.0, 0.0, 0.9, n), camera={"cross_polarized": False}) for n in (1.0, 1.4)],
        nothing_scattered,
    ),
    Case(
        "all photons at one point",
        "a pencil in a medium of 1e6 per mm: density without bound, radius to 0",
        [slab(half_space(ALBEDO, 1e6, 60.0), light=PENCIL)],
        # the point estimate looks at the centers of pixels alone
        shows(SEEN, methods=("beam",)),
    ),
    Case(
        "light of 1, 1e-30 and 1e30 W per mm2",
        "float32 underflows or overflows: in sums, in squares, in the file",
        [lit(power, photons=SAME) for power in POWERS],
        judged(in_proportion, alike),
    ),
    Refused(
        "light beyond what a picture can hold",
        "radiance that float32 makes infinite or 0",
        [lit(1e200), lit(1e-200)],
        "irradiance_W_per_mm2",
    ),
)
