"""Any valid scene, drawn over the whole range of the schema, small enough to run in a fraction of a second."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from skinrender.optics.measured_skin import TONES
from skinrender.scene.schema_skin import LAYER_NAMES

MOST_EVENTS = 300.0
"""Scattering events of a history that a drawn scene may take: more is slow, not wrong."""
PATTERN = "pattern.png"
COLUMNS = 4


def spread(low: float, high: float, *special: float) -> st.SearchStrategy[float]:
    """Numbers even in their logarithm, and special ones."""
    exponents = st.floats(0.0, 1.0).map(lambda u: min(high, max(low, low * (high / low) ** u)))
    return st.one_of(exponents, st.sampled_from([low, high, *special]))


ANISOTROPY = st.one_of(
    st.floats(-0.95, 0.95), st.sampled_from([0.0, 1e-9, -1e-9, 0.999, -0.999, 1.0 - 1e-12, -1.0 + 1e-12, 0.9])
)
INDEX = st.one_of(st.floats(1.0, 3.0), st.sampled_from([1.0, 1.0 + 1e-9, 1.4, 3.0]))
ZENITH = st.one_of(st.floats(0.0, 89.0), st.sampled_from([0.0, 45.0, 89.0]))
AZIMUTH = st.sampled_from([0.0, 45.0, 90.0, 180.0, -360.0, 33.3])


def by_wavelength(value: st.SearchStrategy[float]) -> st.SearchStrategy[Any]:
    return st.one_of(value, st.fixed_dictionaries({380.0: value, 780.0: value}))


@st.composite
def slab_layer(draw) -> dict[str, Any]:
    """A layer by its optical depth, for coefficients alone are mostly clear or opaque."""
    thickness = draw(spread(1e-9, 1e5, 1e-3, 0.1, 1.0))
    depth = draw(spread(1e-6, 1e5, 0.0, 1.0))
    albedo = draw(st.sampled_from([0.0, 0.5, 0.9, 0.999, 1.0 - 1e-6, 1.0]))
    mu_t = min(depth / thickness, 1e6)
    mu_a, mu_s = (1.0 - albedo) * mu_t, albedo * mu_t
    return {
        "thickness_mm": thickness,
        "mu_a_per_mm": draw(st.sampled_from([mu_a, {380.0: mu_a, 780.0: 0.5 * mu_a}])),
        "mu_s_per_mm": mu_s,
        "g": draw(by_wavelength(ANISOTROPY)),
        "refractive_index": draw(by_wavelength(INDEX)),
        "voxel_layers": draw(st.integers(1, 4)) if thickness > 1e-8 else 1,
    }


def events(layer: dict[str, Any]) -> float:
    """About how many scatterings a history has in a layer."""
    mu_a = layer["mu_a_per_mm"]
    mu_a = min(mu_a.values()) if isinstance(mu_a, dict) else mu_a
    depth = layer["mu_s_per_mm"] * layer["thickness_mm"]
    return min(layer["mu_s_per_mm"] / mu_a if mu_a > 0.0 else 1e300, 10.0 * (1.0 + depth))


SLABS = (
    st.lists(slab_layer(), min_size=1, max_size=4)
    .filter(lambda layers: sum(map(events, layers)) < MOST_EVENTS)
    .map(lambda layers: {"layers": layers})
)


def optional(values: dict[str, st.SearchStrategy]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({}, optional=values)


FRACTION = st.one_of(st.floats(0.0, 1.0), st.sampled_from([0.0, 1.0]))
OVERRIDE = optional(
    {
        "thickness_um": spread(1.0, 1e4), "voxel_layers": st.integers(1, 12), "melanosome": FRACTION, "blood": FRACTION,
        "saturation": FRACTION, "vessel_radius_um": spread(1e-3, 1e4, 0.0), "water": st.floats(0.0, 0.5),
        "fat": st.floats(0.0, 0.5), "g": ANISOTROPY, "refractive_index": INDEX,
    }
)  # fmt: skip
SKINS = st.fixed_dictionaries(
    {"site": st.sampled_from(["forearm", "cheek"])},
    optional={
        "tone": st.sampled_from(TONES),
        "pheomelanin": FRACTION,
        "layers": st.dictionaries(st.sampled_from(LAYER_NAMES), OVERRIDE, max_size=4),
        "border_wave": optional({"peak_to_valley_um": st.floats(0.0, 60.0), "period_um": spread(1.0, 1e5)}),
    },
)
LESIONS = st.one_of(
    st.fixed_dictionaries({"kind": st.just("epidermal"), "pattern": st.just(PATTERN), "melanin_scale": FRACTION}),
    st.fixed_dictionaries(
        {
            "kind": st.just("dermal"), "pattern": st.just(PATTERN), "melanin_scale": FRACTION,
            "center_layer": st.integers(1, 60), "half_layers": st.integers(0, 30),
        }
    ),
)  # fmt: skip
FURROWS = st.fixed_dictionaries(
    {
        "angle_deg": AZIMUTH, "spacing_mm": spread(1e-2, 1e4), "depth_um": spread(1e-3, 2000.0, 0.0, 50.0),
        "width_um": spread(1e-2, 1e5, 100.0),
    }
)  # fmt: skip
RELIEF = st.one_of(
    st.just({"kind": "flat"}),
    st.fixed_dictionaries(
        {
            "kind": st.just("procedural"), "families": st.lists(FURROWS, max_size=2), "noise_um": spread(1e-3, 100.0, 0.0),
            "samples": st.sampled_from([[4, 4], [16, 4], [32, 32]]),
        }
    ),
)  # fmt: skip
AGED = st.fixed_dictionaries(
    {
        "kind": st.just("procedural"), "age_years": st.sampled_from([0, 30, 55, 120]),
        "anisotropy": st.sampled_from([None, 0, 0.9]), "samples": st.just([32, 32]),
    }
)  # fmt: skip


@st.composite
def light(draw, size: list[float]) -> dict[str, Any]:
    """A lamp of any kind; beams stay on the patch."""
    place = [draw(st.sampled_from([0.0, 0.25, 0.5, 1.0])) * side for side in size]
    power, spectrum = draw(spread(1e-30, 1e30, 1.0)), draw(st.sampled_from(["E", "D65", "A", "LED-B3"]))
    kind = draw(st.sampled_from(["sky", "point", "patch", "disc", "pencil"]))
    if kind == "sky":
        return {"kind": "sky", "radiance_W_per_mm2_sr": power, "spectrum": spectrum}
    if kind == "point":
        height = draw(spread(1e-3, 1e7, 100.0))
        lamp = {"kind": "point", "height_mm": height, "intensity_W_per_sr": power, "spectrum": spectrum}
        return {**lamp, "position_mm": [3.0 * p - s for p, s in zip(place, size)]}
    zenith = draw(ZENITH)
    beam = {"kind": "collimated", "zenith_deg": zenith, "azimuth_deg": draw(AZIMUTH), "spectrum": spectrum}
    if kind == "patch":
        return {**beam, "irradiance_W_per_mm2": power}
    if kind == "pencil":
        return {**beam, "radius_mm": 0.0, "power_W": power, "position_mm": place}
    reach = 0.4 * min(size) * (1.0 if zenith < 1.0 else 1e-6)
    return {**beam, "radius_mm": draw(spread(1e-9 * reach, reach)), "irradiance_W_per_mm2": power}


@st.composite
def camera(draw, size: list[float]) -> dict[str, Any]:
    """A camera of few pixels anywhere above."""
    view = {
        "pixels": draw(st.sampled_from([[4, 4], [1, 1], [1, 5], [4, 1], [3, 2]])),
        "zenith_deg": draw(ZENITH), "azimuth_deg": draw(AZIMUTH), "cross_polarized": draw(st.booleans()),
    }  # fmt: skip
    if draw(st.booleans()):
        view["window_mm"] = [min(1e4, max(1e-3, draw(spread(0.01, 10.0)) * side)) for side in size]
    if draw(st.booleans()):
        view |= {"kind": "perspective", "distance_mm": draw(spread(1e-3, 1e7))}
    return view


@st.composite
def scenes(draw) -> dict[str, Any]:
    """A scene that a user could write."""
    side = draw(spread(1e-3, 1e4, 1.0, 10.0))
    size = [side, min(1e4, max(1e-3, side * draw(st.sampled_from([1.0, 1.0, 0.1, 30.0]))))]
    described: dict[str, Any] = {
        "patch": {"size_mm": size, "columns": [COLUMNS, COLUMNS]},
        "bands_nm": draw(
            st.sampled_from([[550], [380, 780], [414, 550, 700], {"start": 400, "stop": 700, "step": 100}])
        ),
        "relief": draw(RELIEF),
        "sides": draw(st.sampled_from(["periodic", "open", "dielectric"])),
        "inner_borders": draw(st.sampled_from(["auto", "fresnel", "matched"])),
        "outside": {"refractive_index": draw(INDEX)},
        "light": draw(light(size)),
        "camera": draw(camera(size)),
        "finish": {"roughness": draw(spread(1e-3, 1.0, 1e-6)), "oil": draw(FRACTION)},
        "photons": {"stored": draw(st.integers(1, 300)), "roulette": draw(st.booleans())},
        "estimate": {"gather_count": draw(st.sampled_from([None, 1, 10**9]))},
    }
    if draw(st.booleans()):
        return {**described, "slab": draw(SLABS), "below": {"refractive_index": draw(st.one_of(st.none(), INDEX))}}
    described["relief"] = draw(st.one_of(st.just(described["relief"]), AGED))
    return {**described, "skin": draw(SKINS), "lesions": draw(st.lists(LESIONS, max_size=2))}
