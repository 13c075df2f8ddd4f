"""Reading and writing a block of lanes in tests."""

from __future__ import annotations

import numpy as np

from skinrender.transport.lanes import LANES


def row(buffer: np.ndarray, start: int, n: int = LANES) -> np.ndarray:
    """View of the first n lanes of the quantity that begins at `start` (see `transport.lanes`)."""
    return buffer[start : start + n]
