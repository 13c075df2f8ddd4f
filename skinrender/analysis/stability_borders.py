"""Extremes of borders: index steps, grazing light and cameras, thin and vanishing layers."""

from __future__ import annotations

import math

from skinrender.analysis.closed_forms import (
    border_reflectance,
    clear_stack,
    half_space_diffuse_reflectance,
    half_space_radiance,
    half_space_reflectance,
)
from skinrender.analysis.stability_case import Case
from skinrender.analysis.stability_judges import (
    alike,
    alike_in_picture,
    expects,
    judged,
    nothing_scattered,
    pictures_agree,
    shows,
)
from skinrender.analysis.stability_scenes import NORMAL, half_space, layer, slab

STEPS = (1.0, 1.55, 1.33, 1.0)
GRAZING_DEG = (89.0, 89.9, 89.999)
INK = [layer(3.0, 0.1, 0.0, 0.0, 1.4), layer(1e-3, 300.0, 0.0, 0.0, 1.4), layer(3.0, 0.1, 0.0, 0.0, 1.4)]
INK_TAU = (0.3, 0.3, 0.3)
TURBID = layer(1.0, 0.5, 10.0, 0.5, 1.4)
BLUNT = 0.5


def beam(zenith_deg: float) -> dict:
    return {**NORMAL, "zenith_deg": zenith_deg}


def clear(taus: tuple[float, ...], indices: tuple[float, ...], zenith_deg: float = 0.0) -> dict[str, float]:
    """What `expects` wants of layers that only absorb."""
    reflected, passed, absorbed = clear_stack(taus, indices, math.cos(math.radians(zenith_deg)))
    return {"reflectance": reflected, "transmittance": passed, "absorbed": float(absorbed.sum())}


def specular(zenith_deg: float, n: float = 1.4) -> dict[str, float]:
    return {"specular": border_reflectance(math.cos(math.radians(zenith_deg)), 1.0, n)[0]}


CASES = (
    Case(
        "index steps 1 to 1.55 to 1.33, upright and aslant",
        "refraction and total reflection at each step; reflections back and forth",
        [
            slab(layer(0.5, 0.4, 0.0, 0.0, 1.55), layer(0.5, 0.2, 0.0, 0.0, 1.33), light=beam(zenith))
            for zenith in (0.0, 60.0)
        ],
        judged(expects(*(clear((0.2, 0.1), STEPS, zenith) for zenith in (0.0, 60.0))), nothing_scattered),
    ),
    Case(
        "equal indices of 1.4 everywhere",
        "reflection where there is no step",
        [slab(TURBID, outside={"refractive_index": 1.4}, below={"refractive_index": 1.4})],
        judged(expects({"specular": 0.0}), pictures_agree),
    ),
    Case(
        "index 1 + 1e-9 and 1",
        "Snell's law and Fresnel's formulas near 0/0",
        [slab(layer(1.0, 0.5, 10.0, 0.5, n), light=beam(30.0)) for n in (1.0, 1.0 + 1e-9)],
        judged(alike, alike_in_picture),
    ),
    Case(
        "an index of 3 between 1s, albedo 1",
        "light that total reflection hardly lets out",
        [slab(layer(1.0, 0.0, 5.0, 0.0, 3.0))],
        judged(expects({"absorbed": 0.0, **specular(0.0, 3.0)}), pictures_agree),
    ),
    Case(
        "grazing light, 89 to 89.999 degrees",
        "Fresnel near a cosine of 0; tiles and periods crossed before the surface",
        [slab(layer(1.0, 1.0, 0.0, 0.0, 1.4), below={"refractive_index": 1.4}, light=beam(z)) for z in GRAZING_DEG],
        expects(*({**clear((1.0,), (1.0, 1.4, 1.4), zenith), **specular(zenith)} for zenith in GRAZING_DEG)),
    ),
    Case(
        "grazing light without an index step",
        "a level flight's length: depth over a cosine of 2e-5",
        [slab(layer(1e-3, math.cos(math.radians(z)) * 1e3, 0.0), light=beam(z)) for z in GRAZING_DEG],
        expects(*({"transmittance": math.exp(-1.0), "reflectance": 0.0} for _ in GRAZING_DEG)),
    ),
    Case(
        "grazing camera, 60 to 89.9 degrees, without an index step",
        "weights 1 / cosine; bins drawn out; rays through many columns",
        [slab(half_space(BLUNT, 10.0, 60.0), camera={"zenith_deg": z}) for z in (60.0, 89.0, 89.9)],
        shows(*(half_space_radiance(BLUNT, math.cos(math.radians(z))) for z in (60.0, 89.0, 89.9))),
    ),
    Case(
        "grazing camera and light over an index of 1.4",
        "transmission that vanishes; surface reflection at 89.9 degrees",
        [slab(TURBID, light=beam(89.9), camera={"zenith_deg": 89.9, "azimuth_deg": 180.0, "cross_polarized": False})],
        judged(expects(specular(89.9)), pictures_agree),
    ),
    Case(
        "diffuse light on a half space",
        "directions of the sky down to the horizon",
        [slab(half_space(BLUNT, 10.0, 60.0), light={"kind": "sky", "spectrum": "E"})],
        expects({"reflectance": half_space_diffuse_reflectance(BLUNT)}),
    ),
    Case(
        "1 um of ink between 3 mm",
        "a plane that float32 can't resolve at its depth; a majorant slab of 1/3000 of the volume",
        [slab(*INK, light=beam(zenith)) for zenith in (0.0, 70.0)],
        expects(*(clear(INK_TAU, (1.0, 1.4, 1.4, 1.4, 1.0), zenith) for zenith in (0.0, 70.0))),
    ),
    Case(
        "a layer of 1e-9 mm and none",
        "a layer thinner than any number's resolution; thickness to 0",
        [
            slab(TURBID, {**TURBID, "thickness_mm": 1.0}),
            slab(TURBID, layer(1e-9, 100.0, 100.0, 0.0, 1.4), {**TURBID, "thickness_mm": 1.0}),
        ],
        judged(alike, alike_in_picture),
    ),
    Case(
        "100 mm of clear air over a half space",
        "positions of float32 far from 0; depth slabs that begin below nothing",
        [slab(layer(100.0, 0.0, 0.0), half_space(BLUNT, 10.0, 60.0))],
        # the point estimate's steps are 0.2 mm here, two free paths, and straddle the border
        judged(
            expects({"reflectance": half_space_reflectance(BLUNT)}),
            shows(half_space_radiance(BLUNT, 1.0), methods=("beam",)),
        ),
    ),
)
