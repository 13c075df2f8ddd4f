"""The camera: from a scene's description to the rays along which its pixels look."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinrender.errors import InputError

_START_HEIGHT_MM = 20.0  # parallel rays start at least this far above the mean plane, over any relief


@dataclass(frozen=True)
class ViewRays:
    """Rays of a pixel lattice; row i looks at growing y, column j at growing x.

    Attributes
    ----------
    origin : (h, w, 3), mm, above the skin.
    direction : (h, w, 3), unit, the way the camera looks (the light flies the opposite way).
    """

    origin: np.ndarray
    direction: np.ndarray


def view_rays(camera: Any, size_mm: tuple[float, float], subpixels: int = 1) -> ViewRays:
    """Rays through the pixel centers, or through a regular lattice of subpixels x subpixels points in each pixel.

    The image plane passes through the camera's center on the mean plane z = 0, perpendicular to the view axis, and is
    `window_mm` wide and high. At zenith 0 columns run along x and rows along y; a tilt turns both the short way.

    Parameters
    ----------
    camera : the scene's camera.
    size_mm : (Lx, Ly) of the patch, the default window.
    subpixels : k; the result has (h k, w k) rays.

    Raises
    ------
    InputError : a perspective camera without a positive distance, or a view from below the horizon.
    """
    columns, rows = camera.pixels
    center, (right, down, axis), (width, height), pinhole = image_plane(camera, size_mm)
    across = ((np.arange(columns * subpixels) + 0.5) / (columns * subpixels) - 0.5) * width
    along = ((np.arange(rows * subpixels) + 0.5) / (rows * subpixels) - 0.5) * height
    plane = center + across[None, :, None] * right + along[:, None, None] * down
    if pinhole is not None:
        toward = plane - pinhole
        return ViewRays(
            origin=np.broadcast_to(pinhole, plane.shape).copy(),
            direction=toward / np.linalg.norm(toward, axis=-1, keepdims=True),
        )
    back = (_START_HEIGHT_MM + plane[..., 2].max()) / axis[2]
    return ViewRays(origin=plane - back * axis, direction=np.broadcast_to(axis, plane.shape).copy())


def image_plane(
    camera: Any, size_mm: tuple[float, float]
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray], tuple[float, float], np.ndarray | None]:
    """Center (3,), axes (`view_axes`), extent (width, height) in mm, and the pinhole (3,) of a perspective camera.

    Raises
    ------
    InputError : see `view_rays`.
    """
    extent = tuple(camera.window_mm or size_mm)
    center = np.array([*(camera.center_mm or (0.5 * size_mm[0], 0.5 * size_mm[1])), 0.0])
    axes = view_axes(camera.zenith_deg, camera.azimuth_deg)
    if camera.kind != "perspective":
        return center, axes, extent, None
    if not camera.distance_mm or camera.distance_mm <= 0.0:
        raise InputError(
            "a perspective camera needs its distance from the patch", where="camera.distance_mm", remedy="e.g. 300"
        )
    return center, axes, extent, center - camera.distance_mm * axes[2]


def view_axes(zenith_deg: float, azimuth_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors (right, down, axis) of a camera that stands at this zenith and azimuth and looks at its center.

    The azimuth counts from +x towards +y. Right and down are x and y turned with the axis the short way.
    """
    if not 0.0 <= zenith_deg < 90.0:
        raise InputError(f"the camera's zenith angle must be in [0, 90), got {zenith_deg:g}", where="camera.zenith_deg")
    zenith, azimuth = math.radians(zenith_deg), math.radians(azimuth_deg)
    dx, dy, dz = -math.sin(zenith) * math.cos(azimuth), -math.sin(zenith) * math.sin(azimuth), math.cos(zenith)
    a = 1.0 / (1.0 + dz)
    right = np.array([1.0 - dx * dx * a, -dx * dy * a, -dx])
    down = np.array([-dx * dy * a, 1.0 - dy * dy * a, -dy])
    return right, down, np.array([dx, dy, dz])
