"""Light, camera and film of a Mitsuba scene."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from skinrender.errors import SceneError
from skinrender.export.xml import add, add_look_at, add_number
from skinrender.film.camera import image_plane
from skinrender.photonmap.light import CollimatedLight, Light, PointLight

LAMP_RADIUS = 0.05
"""Of the sphere that stands for a point light, relative to its height."""
SPOT_DISTANCE = 100.0
"""Of the spot that stands for a beam, in radii of the beam."""
_START_MM = 20.0


def add_light(parent: ET.Element, light: Light, band: int, refracts: bool) -> list[str]:
    """Add the scene's light; returns what is otherwise in Mitsuba.

    refracts : whether the surface does. Mitsuba's paths end in a light that they hit by chance or that they see; through a
    surface that refracts they see none, and a light without extent is never hit.

    Raises
    ------
    InputError : a pencil of light, or parallel light on a surface that refracts.
    """
    if isinstance(light, PointLight):
        return _add_lamp(parent, light, band, refracts)
    if isinstance(light, CollimatedLight):
        return _add_beam(parent, light, band, refracts)
    sky = add(parent, "emitter", type="constant")
    _add_emission(sky, "radiance", light.radiance[band])
    return []


def add_sensor(parent: ET.Element, camera: Any, size_mm: tuple[float, float]) -> ET.Element:
    """Add the camera and its film; raises `InputError` for pixels that are not square, which Mitsuba has not."""
    center, (right, down, axis), (width, height), pinhole = image_plane(camera, size_mm)
    columns, rows = camera.pixels
    if not math.isclose(width / columns, height / rows, rel_tol=1e-6):
        raise SceneError(
            f"pixels of {width / columns:.4g} x {height / rows:.4g} mm are not square, which Mitsuba needs",
            key=("camera", "pixels"), remedy="choose `camera.window_mm` in the ratio of `camera.pixels`",
        )  # fmt: skip
    sensor = add(parent, "sensor", type="orthographic" if pinhole is None else "perspective")
    if pinhole is None:
        distance = (_START_MM + 0.5 * height * abs(down[2]) + 0.5 * width * abs(right[2])) / axis[2]
        add_look_at(sensor, center - distance * axis, center, -down, scale=0.5 * width)
    else:
        distance = camera.distance_mm
        add_number(sensor, "fov", math.degrees(2.0 * math.atan2(0.5 * width, distance)))
        add(sensor, "string", name="fov_axis", value="x")
        add_look_at(sensor, pinhole, center, -down)
    add_number(sensor, "near_clip", 1e-4 * distance)
    add_number(sensor, "far_clip", 1e3 * distance)
    sampler = add(sensor, "sampler", type="independent")
    add(sampler, "integer", name="sample_count", value="$spp")
    film = add(sensor, "film", type="hdrfilm")
    add_number(film, "width", columns, "integer")
    add_number(film, "height", rows, "integer")
    add(film, "string", name="pixel_format", value="luminance")
    add(film, "string", name="component_format", value="float32")
    add(film, "rfilter", type="box")
    return sensor


def _add_lamp(parent: ET.Element, light: PointLight, band: int, refracts: bool) -> list[str]:
    place = {name: f"{value:.9g}" for name, value in zip("xyz", light.position_mm)}
    if not refracts:
        lamp = add(parent, "emitter", type="point")
        add(lamp, "point", name="position", **place)
        _add_emission(lamp, "intensity", light.intensity[band])
        return []
    radius = LAMP_RADIUS * -float(light.position_mm[2])
    sphere = add(parent, "shape", type="sphere")
    add(sphere, "point", name="center", **place)
    add_number(sphere, "radius", radius)
    _add_emission(add(sphere, "emitter", type="area"), "radiance", light.intensity[band] / (math.pi * radius**2))
    return [f"the point light is a sphere of radius {radius:g} mm of the same intensity: through a surface that refracts no "
            "path finds a point"]  # fmt: skip


def _add_beam(parent: ET.Element, light: CollimatedLight, band: int, refracts: bool) -> list[str]:
    if light.radius_mm == 0.0 or refracts:
        what = "a pencil of light" if light.radius_mm == 0.0 else "parallel light on a surface that refracts"
        raise SceneError(
            f"Mitsuba's path tracer cannot find {what}", key=("light",),
            remedy="use a sky or point light, or a beam of some radius with `outside.refractive_index` as the tissue's",
        )  # fmt: skip
    if light.radius_mm is None:
        sun = add(parent, "emitter", type="directional")
        add(sun, "vector", name="direction", **{name: f"{value:.9g}" for name, value in zip("xyz", light.direction)})
        _add_emission(sun, "irradiance", light.irradiance[band])
        return []
    distance = SPOT_DISTANCE * light.radius_mm
    angle = math.degrees(math.atan(1.0 / SPOT_DISTANCE))
    spot = add(parent, "emitter", type="spot")
    add_number(spot, "cutoff_angle", angle)
    add_number(spot, "beam_width", 0.999 * angle)
    target = np.array([*light.position_mm, 0.0])
    add_look_at(spot, target - distance * light.direction, target, np.array([0.0, 1.0, 0.0]))
    _add_emission(spot, "intensity", light.irradiance[band] * distance**2)
    return [f"the beam is a spot {distance:g} mm away, which diverges by {angle:.2g} degrees"]


def _add_emission(parent: ET.Element, name: str, value: float) -> None:
    add(parent, "spectrum", name=name, value=f"{value:.9g}")
