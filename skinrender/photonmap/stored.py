"""Where a walk stores its photons: arrays that grow, so that no photon is copied once more when a round is finished."""

from __future__ import annotations

import numpy as np

from skinrender.transport.lanes import LANES

LEAST = 1 << 16
"""Photons for which there is room at first, at least."""
_SPARE = 1.05
"""Room over the photons expected, so that a round that stores somewhat more than the one before need not grow."""


class StoredPhotons:
    """Photons of a round while it is walked.

    position (3 capacity,) f4, mm, and direction (capacity,) i4, two u2 of an octahedral code, are filled up to `count`
    photons.

    Parameters
    ----------
    expected : photons that the round may store; more find room too.
    """

    def __init__(self, expected: int = 0):
        capacity = max(LEAST, int(_SPARE * expected)) + LANES
        self.count = 0
        self.position = np.empty(3 * capacity, np.float32)
        self.direction = np.empty(capacity, np.int32)

    def make_room(self) -> None:
        """Grow by a half where fewer photons than a block has lanes would still fit."""
        capacity = len(self.direction)
        if self.count + LANES <= capacity:
            return
        capacity += capacity // 2
        self.position = _grown(self.position, 3 * capacity, 3 * self.count)
        self.direction = _grown(self.direction, capacity, self.count)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Position (count, 3) f4 and direction (count, 2) u2, as a map has them."""
        direction = self.direction[: self.count].view(np.uint16)
        return self.position[: 3 * self.count].reshape(-1, 3), direction.reshape(-1, 2)


def _grown(array: np.ndarray, size: int, used: int) -> np.ndarray:
    """A larger array (size,) with the first `used` values of one that has become too small."""
    larger = np.empty(size, array.dtype)
    larger[:used] = array[:used]
    return larger
