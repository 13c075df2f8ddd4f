"""Small pieces of a Mitsuba scene file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np


def add(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """A new element under `parent`."""
    return ET.SubElement(parent, tag, attributes)


def add_number(parent: ET.Element, name: str, value: float, tag: str = "float") -> None:
    """A named number."""
    add(parent, tag, name=name, value=f"{value:.9g}")


def add_matrix(parent: ET.Element, columns: Sequence[np.ndarray], center: Sequence[float]) -> None:
    """A ``to_world`` transform with these three columns (3,) and this translation, mm."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.stack(columns, axis=1), center
    transform = add(parent, "transform", name="to_world")
    add(transform, "matrix", value=" ".join(f"{value:.9g}" for value in matrix.ravel()))


def add_look_at(parent: ET.Element, origin: np.ndarray, target: np.ndarray, up: np.ndarray, scale: float = 1.0) -> None:
    """A ``to_world`` transform of a camera."""
    transform = add(parent, "transform", name="to_world")
    if scale != 1.0:
        add(transform, "scale", x=f"{scale:.9g}", y=f"{scale:.9g}")
    add(
        transform,
        "lookat",
        **{name: _triple(value) for name, value in zip(("origin", "target", "up"), (origin, target, up))},
    )


def _triple(values: np.ndarray) -> str:
    return ", ".join(f"{value:.9g}" for value in values)
