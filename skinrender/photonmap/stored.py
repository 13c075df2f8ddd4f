"""Where a walk stores its photons: arrays that grow, so that no photon is copied once more when a round is finished."""

from __future__ import annotations

import numpy as np

from skinrender.transport.lanes import LANES

LEAST = 1 << 16
_SPARE = 1.05


class StoredPhotons:
    """Photons of a round while it is walked.

    Parameters
    ----------
    expected : photons that the round may store; more find room too.

    position (3 capacity,) f4 and direction (capacity,) i4 are filled up to `count` photons.
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
        return self.position[: 3 * self.count].reshape(-1, 3), self.direction[: self.count].view(np.uint16).reshape(-1, 2)


def _grown(array: np.ndarray, size: int, used: int) -> np.ndarray:
    larger = np.empty(size, array.dtype)
    larger[:used] = array[:used]
    return larger
