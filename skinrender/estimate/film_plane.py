"""Where on the film a point of the skin is seen: the camera as the kernels of the reference estimate read it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skinrender.film.camera import image_plane
from skinrender.transport import kernel


class FilmPlane(NamedTuple):
    """The camera's image plane, which passes through its center; lengths in mm.

    is_pinhole : else all rays are parallel to the axis. x, y, z: the pinhole, or the center.
    right, down, axis : unit vectors (3,) of growing column, of growing row, and the way the camera looks.
    distance : from pinhole to plane. per_mm_x, per_mm_y: pixels per mm; columns, rows: of the picture.
    """

    is_pinhole: bool
    x: float
    y: float
    z: float
    right: np.ndarray
    down: np.ndarray
    axis: np.ndarray
    distance: float
    per_mm_x: float
    per_mm_y: float
    columns: int
    rows: int


def make_film_plane(camera: Any, size_mm: tuple[float, float]) -> FilmPlane:
    """Executed form of a scene's camera over a patch of this size."""
    center, (right, down, axis), (width, height), pinhole = image_plane(camera, size_mm)
    columns, rows = camera.pixels
    x, y, z = map(float, center if pinhole is None else pinhole)
    distance = 0.0 if pinhole is None else float(camera.distance_mm)
    return FilmPlane(
        pinhole is not None, x, y, z, right, down, axis, distance, columns / width, rows / height, columns, rows
    )


@kernel
def view_direction(film, x, y, z):
    """Direction of the view ray that meets the point (x, y, z), and its distance from the pinhole (1 for parallel rays)."""
    if not film.is_pinhole:
        return film.axis[0], film.axis[1], film.axis[2], 1.0
    dx, dy, dz = x - film.x, y - film.y, z - film.z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    return dx / distance, dy / distance, dz / distance, distance


@kernel
def pixel_of_point(film, x, y, z):
    """Pixel (row x columns + column) in whose box the point outside the skin is seen, or -1."""
    dx, dy, dz = x - film.x, y - film.y, z - film.z
    scale = 1.0
    if film.is_pinhole:
        scale = film.distance / (dx * film.axis[0] + dy * film.axis[1] + dz * film.axis[2])
    across = scale * (dx * film.right[0] + dy * film.right[1] + dz * film.right[2])
    along = scale * (dx * film.down[0] + dy * film.down[1] + dz * film.down[2])
    column = math.floor(across * film.per_mm_x + 0.5 * film.columns)
    row = math.floor(along * film.per_mm_y + 0.5 * film.rows)
    if column < 0 or column >= film.columns or row < 0 or row >= film.rows:
        return -1
    return row * film.columns + column


@kernel
def pixels_per_area(film, ux, uy, uz, distance):
    """Pixels that an area of 1 mm2 perpendicular to the view ray, at a distance from the pinhole, covers."""
    density = film.per_mm_x * film.per_mm_y
    if film.is_pinhole:
        cosine = ux * film.axis[0] + uy * film.axis[1] + uz * film.axis[2]
        magnified = film.distance / (distance * cosine)
        return density * magnified * magnified / cosine
    return density


def footprint_mm(film: FilmPlane, z_low: float, z_high: float) -> np.ndarray:
    """Box (low x, low y, high x, high y) around where the view rays meet the planes z_low to z_high."""
    corners = []
    for a in (-0.5, 0.5):
        for b in (-0.5, 0.5):
            offset = a * film.columns / film.per_mm_x * film.right + b * film.rows / film.per_mm_y * film.down
            start = np.array([film.x, film.y, film.z])
            toward = film.axis
            if film.is_pinhole:
                toward = film.distance * film.axis + offset
            else:
                start = start + offset
            corners += [(start + (z - start[2]) / max(toward[2], 1e-6) * toward)[:2] for z in (z_low, z_high)]
    return np.concatenate([np.min(corners, axis=0), np.max(corners, axis=0)])
