"""Mitsuba's binary grid volume, version 3: magic, data type, size, channels, bounding box, floats with x fastest."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from skinrender.atomic import whole_file

_FLOAT32 = 1
_UNIT_CUBE = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)


def write_vol(path: Path, values: np.ndarray) -> None:
    """Write a grid (nx, ny, nz) of one channel; raises RunError when that is not possible."""
    header = b"VOL" + struct.pack("<B5i6f", 3, _FLOAT32, *values.shape, 1, *_UNIT_CUBE)
    with whole_file(path) as partial, open(partial, "wb") as file:
        file.write(header)
        for plane in np.moveaxis(values, 2, 0):
            file.write(np.ascontiguousarray(plane.T, dtype="<f4").data)
