"""Reading and writing a block of lanes in tests."""

from __future__ import annotations

import numpy as np

from skinrender.transport.lanes import LANES, SLAB_DEPTH
from skinrender.transport.medium import flight_constants


def row(buffer: np.ndarray, start: int, n: int = LANES) -> np.ndarray:
    """View of the first n lanes of the quantity that begins at `start` (see `transport.lanes`)."""
    return buffer[start : start + n]


def set_slabs(f: np.ndarray, majorant: np.ndarray) -> None:
    """Gives all lanes the slabs of a majorant (see `medium.make_majorant`)."""
    constants = flight_constants(majorant, f.dtype.type)
    f[SLAB_DEPTH : SLAB_DEPTH + constants.size * LANES].reshape(-1, LANES)[:] = constants[:, None]
