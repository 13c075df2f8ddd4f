"""Extremes of the tissue's optics: absorption, albedo, anisotropy, optical depth."""

from __future__ import annotations

import math
from collections.abc import Sequence

from skinrender.analysis.closed_forms import conservative_transmittance, half_space_radiance, half_space_reflectance
from skinrender.analysis.slab_stats import events
from skinrender.analysis.stability_case import Case, Judge, Measure, Outcome
from skinrender.analysis.stability_judges import (
    alike,
    alike_in_picture,
    expects,
    judged,
    nothing_scattered,
    pictures_agree,
    shows,
)
from skinrender.analysis.stability_scenes import PENCIL, half_space, layer, slab
from skinrender.transport import tally

ABSORPTION = (1e-4, 1.0, 20.0, 1e5)
HALF_SPACES = ((0.5, 1e-3), (5.0 / 12.0, 1200.0), (0.5, 2e6), (0.999, 10.0))
"""Albedo and extinction (1/mm); the second is the strongest absorption and scattering that skin is allowed."""
THIN = 1e-4
NEARLY_1 = 1.0 - 1e-6
SHARP = 0.999
SHARP_LIGHT = (
    {"reflectance": 0.0098348, "transmittance": 0.938562, "absorbed": 0.0516033},
    {"reflectance": 0.804696, "transmittance": 0.147443, "absorbed": 0.0478618},
)
"""Light of the two slabs below from 4e6 histories of a plain walk in double precision; standard errors up to 2e-4."""


def events_as_deep(optical_depth: float) -> Judge:
    """Scattering events of a history in a thin layer, to first order in its optical depth."""

    def judge(outcomes: Sequence[Outcome]) -> list[Measure]:
        [outcome] = outcomes
        column = tally.PER_LAYER + 1
        got, stderr = outcome.light.fractions[0, column], outcome.light.fractions_stderr[0, column]
        result = events("", "", optical_depth, optical_depth**2, float(got), float(stderr), outcome.light.emitted)
        return [Measure("z of scattering events", abs(result.z), 4.0)]

    return judge


CASES = (
    Case(
        "absorption alone, optical depth 1e-4 to 1e5",
        "exp underflows; a map without photons; the first flight's length",
        [slab(layer(1.0, tau, 0.0)) for tau in ABSORPTION],
        judged(expects(*({"reflectance": 0.0, "transmittance": math.exp(-tau)} for tau in ABSORPTION)), nothing_scattered),
    ),
    Case(
        "neither absorption nor scattering",
        "0/0 albedo, endless free path, empty map",
        [slab(layer(1.0, 0.0, 0.0))],
        judged(expects({"transmittance": 1.0, "absorbed": 0.0, "transmittance_unscattered": 1.0}), nothing_scattered),
    ),
    Case(
        "albedo 1, optical depth 300 and 1000",
        "paths of 1e5 scatterings: drift of directions and depths in float32, energy, endless walks",
        [slab(layer(0.1 * tau, 0.0, 10.0), photons={"stored": stored}) for tau, stored in ((300.0, 3e5), (1000.0, 1e5))],
        expects(*({"absorbed": 0.0, "transmittance": conservative_transmittance(tau)} for tau in (300.0, 1000.0))),
    ),
    Case(
        "albedo 1 - 1e-6, optical depth 1e4",
        "an albedo that float32 rounds to 1; absorption of one event in a million",
        [slab(half_space(NEARLY_1))],
        judged(expects({"reflectance": half_space_reflectance(NEARLY_1), "transmittance": 0.0}), pictures_agree),
    ),
    Case(
        "half spaces of extinction 1e-3, 1200 and 2e6 per mm",
        "steps, kernels and depth slabs of fixed length against free paths of 0.5 nm to 1 m",
        [slab(half_space(albedo, mu_t, 50.0)) for albedo, mu_t in HALF_SPACES[:3]],
        judged(
            expects(*({"reflectance": half_space_reflectance(albedo)} for albedo, _ in HALF_SPACES[:3])),
            shows(*(half_space_radiance(albedo, 1.0) for albedo, _ in HALF_SPACES[:3])),
        ),
    ),
    Case(
        "half space of albedo 0.999",
        "pictures of deep light; normalization of kernels",
        [slab(half_space(0.999, 10.0, 400.0), photons={"stored": 2e5})],
        judged(expects({"reflectance": half_space_reflectance(0.999)}), shows(half_space_radiance(0.999, 1.0))),
    ),
    Case(
        "g = 0 and +-1e-9",
        "the sampler of Henyey-Greenstein is 0/0 at g = 0 in its textbook form",
        [slab(layer(1.0, 1.0, 5.0, g)) for g in (0.0, 1e-9, -1e-9)],
        judged(alike, alike_in_picture),
    ),
    Case(
        "g = 0.999 and -0.999",
        "a cosine of 1 or beyond it in float32; the peak of the phase function in pictures",
        [slab(layer(1.0, 0.05, 50.0, SHARP)), slab(layer(1.0, 0.05, 5.0, -SHARP))],
        judged(expects(*SHARP_LIGHT, accuracy=2e-4), pictures_agree),
    ),
    Case(
        "scattering depth 1e-4",
        "a map of few photons from many histories; the first scattering counted",
        [slab(layer(1.0, 0.0, THIN), light=PENCIL, photons={"stored": 500})],
        events_as_deep(THIN),
    ),
    Case(
        "scattering 1e-12 per mm and none",
        "a limit that is not met: empty map against one of no photons",
        [slab(layer(1.0, 1.0, mu_s)) for mu_s in (0.0, 1e-12)],
        alike,
    ),
    Case(
        "absorption 1e-12 per mm and none",
        "an integer threshold rounded to 0 or to one in 2^32",
        [slab(layer(1.0, mu_a, 10.0)) for mu_a in (0.0, 1e-12)],
        judged(alike, alike_in_picture, expects({"absorbed": 0.0}, {"absorbed": 0.0})),
    ),
    Case(
        "a voxel of optical depth 75, whole and cut",
        "the free path against the size of voxels; voxels of 1/100 of a free path",
        [
            slab(layer(0.1, 400.0, 350.0, 0.5, voxel_layers=count), columns=columns)
            for count, columns in ((1, 1), (1000, 16), (1, 64))
        ],
        judged(alike, alike_in_picture),
    ),
)
