"""Checks between the sections of a scene, each of whose values is right by itself."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from typing import Any

from skinrender.scene.problems import Problem, did_you_mean
from skinrender.scene.schema import Scene
from skinrender.scene.schema_lesion import INKS
from skinrender.scene.schema_light import ILLUMINANTS

Found = Iterator[Problem]


def presence_problems(data: dict[str, Any]) -> Found:
    """Which sections stand together; needs no value to be right."""
    skin, slab = data.get("skin") is not None, data.get("slab") is not None
    if skin and slab:
        yield Problem(("slab",), "stands beside skin; a scene has either skin or slab, remove one of them")
    elif "skin" in data and not skin and not slab:
        yield Problem(("skin",), "holds nothing; write 'skin: {site: forearm}'")
    elif not skin and not slab:
        yield Problem((), "has neither skin nor slab; add 'skin: {site: forearm}' or a slab with its layers")
    if slab and not skin and data.get("lesions"):
        yield Problem(("lesions",), "lesions need skin; remove them, or describe the tissue by skin in place of slab")


def cross_problems(scene: Scene, wrong: frozenset[str] = frozenset()) -> Found:
    """Problems between sections; sections in `wrong` hold stand-ins and are left out."""
    for sections, check in _CHECKS:
        if not wrong.intersection(sections):
            yield from check(scene)


def _camera_center(scene: Scene) -> Found:
    yield from _outside_patch(scene, ("camera", "center_mm"), scene.camera.center_mm)


def _beam(scene: Scene) -> Found:
    light = scene.light
    if light.kind != "collimated":
        return
    usual = type(light).model_fields
    if light.radius_mm is None and light.position_mm is not None:
        text = "has no effect on a beam over the whole patch; add radius_mm, or remove it"
        yield Problem(("light", "position_mm"), text)
    else:
        inside = list(_outside_patch(scene, ("light", "position_mm"), light.position_mm))
        yield from inside or _footprint(scene)
    if light.radius_mm == 0 and light.irradiance_W_per_mm2 != usual["irradiance_W_per_mm2"].default:
        yield Problem(("light", "irradiance_W_per_mm2"), "a pencil (radius_mm: 0) has no irradiance; give power_W")
    if light.radius_mm != 0 and light.power_W != usual["power_W"].default:
        yield Problem(("light", "power_W"), "only a pencil (radius_mm: 0) has a power; give irradiance_W_per_mm2")


def _footprint(scene: Scene) -> Found:
    """A disc of light must fall on the patch as a whole, for its power is that of the whole beam."""
    light, size = scene.light, scene.patch.size_mm
    if not light.radius_mm:
        return
    slope, azimuth = math.tan(math.radians(light.zenith_deg)), math.radians(light.azimuth_deg)
    place = light.position_mm or (size[0] / 2, size[1] / 2)
    for center, side, cosine in zip(place, size, (math.cos(azimuth), math.sin(azimuth)), strict=True):
        reach = light.radius_mm * math.hypot(1, slope * cosine)
        if reach > min(center, side - center):
            text = f"got {light.radius_mm:g}; the beam reaches beyond the patch, make it smaller or move it, "
            yield Problem(("light", "radius_mm"), text + "or leave radius_mm out to light the whole patch")
            return


def _outside_patch(scene: Scene, path: tuple[str, ...], place: tuple[float, float] | None) -> Found:
    size = scene.patch.size_mm
    if place is not None and not all(0 <= p <= s for p, s in zip(place, size, strict=True)):
        got, limits = (f"[{a:g}, {b:g}]" for a, b in (place, size))
        yield Problem(path, f"got {got}, outside the patch; expected a place from [0, 0] to {limits}")


def _furrows(scene: Scene) -> Found:
    if scene.skin is None and scene.relief.kind == "procedural" and scene.relief.families is None:
        yield Problem(("relief", "families"), "missing; only skin has furrows of its own, list those of the slab")


def _tables(scene: Scene) -> Found:
    """Tables by wavelength must reach over all bands: values are never carried on beyond their ends."""
    tables = {("outside", "refractive_index"): scene.outside.refractive_index}
    tables["below", "refractive_index"] = scene.below.refractive_index
    layers = scene.skin.layers.items() if scene.skin else enumerate(scene.slab.layers if scene.slab else ())
    section = "skin" if scene.skin else "slab"
    for name, layer in layers:
        for key in ("mu_a_per_mm", "mu_s_per_mm", "g", "refractive_index"):
            tables[section, "layers", str(name), key] = getattr(layer, key)
    first, last = scene.wavelength_nm[0], scene.wavelength_nm[-1]
    for path, table in tables.items():
        if isinstance(table, dict) and (min(table) > first or max(table) < last):
            text = f"the table spans {min(table):g} to {max(table):g} nm, the bands {first:g} to {last:g} nm"
            yield Problem(path, text + "; add entries, or narrow bands_nm")


def _spectrum(scene: Scene) -> Found:
    yield from _unknown_spectrum(scene, ("light", "spectrum"), scene.light.spectrum, ILLUMINANTS)


def _unknown_spectrum(scene: Scene, path: tuple[str, ...], name: str, known: tuple[str, ...]) -> Found:
    """A spectrum is known by its name or is a CSV file."""
    if name in known:
        return
    if not name.lower().endswith(".csv"):
        allowed = ", ".join(f"'{spectrum}'" for spectrum in known)
        yield Problem(path, f"got '{name}'; allowed: {allowed} or a .csv file{did_you_mean(name, known)}")
    else:
        yield from _missing_file(scene, path, name)


def _lesion_files(scene: Scene) -> Found:
    for i, lesion in enumerate(scene.lesions):
        yield from _missing_file(scene, ("lesions", str(i), "pattern"), lesion.pattern)
        if lesion.kind == "tattoo":
            yield from _unknown_spectrum(scene, ("lesions", str(i), "ink"), lesion.ink, INKS)


def _height_map(scene: Scene) -> Found:
    if scene.relief.kind == "height_map":
        yield from _missing_file(scene, ("relief", "file"), scene.relief.file)


def _missing_file(scene: Scene, path: tuple[str, ...], name: str) -> Found:
    place = scene.path(name)
    # os.path, for pathlib raises on names that no file can have.
    if os.path.isfile(place):
        return
    if os.path.exists(place):
        yield Problem(path, f"got '{name}', which is a folder or a device, not a file; name an image or a table")
        return
    near = [p.name for p in place.parent.glob("*")] if os.path.isdir(place.parent) else []
    text = f"got '{name}'; there is no such file in '{place.parent}'{did_you_mean(place.name, near)}"
    yield Problem(path, text + "; a path is relative to the scene file")


_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Scene], Found]], ...] = (
    (("patch", "camera"), _camera_center),
    (("patch", "light"), _beam),
    (("skin", "slab", "relief"), _furrows),
    (("skin", "slab", "outside", "below", "bands_nm"), _tables),
    (("light",), _spectrum),
    (("lesions",), _lesion_files),
    (("relief",), _height_map),
)
