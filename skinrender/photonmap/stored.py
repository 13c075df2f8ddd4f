"""Where a walk stores its photons: arrays that grow, and their order by bands."""

from __future__ import annotations

import numpy as np

from skinrender.transport import entry_kernel
from skinrender.transport.lanes import LANES
from skinrender.transport.tally import WAYS

LEAST = 1 << 16
"""Photons for which there is room at first, at least."""
_SPARE = 1.05
"""Room over the photons expected, so that a round that stores somewhat more than the one before need not grow."""


class StoredPhotons:
    """Photons of a round while it is walked, in the order of their scattering.

    arrays: position (3 capacity,) f4, mm, direction (capacity,) i4, two u2 of an octahedral code, and band (capacity,)
    u1, filled up to `count` photons.

    Parameters
    ----------
    expected : photons that the round may store; more find room too.
    """

    def __init__(self, expected: int = 0):
        capacity = max(LEAST, int(_SPARE * expected)) + LANES
        self.count = 0
        self.arrays = np.empty(3 * capacity, np.float32), np.empty(capacity, np.int32), np.empty(capacity, np.uint8)

    def make_room(self) -> None:
        """Grow by a half where fewer photons than a block has lanes would still fit."""
        capacity = self.arrays[2].size
        if self.count + LANES <= capacity:
            return
        self.arrays = tuple(
            _grown(array, (capacity + capacity // 2) * each, self.count * each)
            for array, each in zip(self.arrays, (3, 1, 1))
        )

    def in_band_order(self, bands: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position (count, 3) f4 and direction (count, 2) u2, as a map has them, and how many each of B bands has, (B,)
        i8."""
        position, direction, band = self.arrays
        position, direction, band = position[: 3 * self.count], direction[: self.count], band[: self.count]
        stored = _count_bands(band, np.zeros((WAYS, bands), np.int64)).sum(axis=0)
        if np.count_nonzero(stored) > 1:
            ordered = np.empty_like(position), np.empty_like(direction)
            _put_in_order(position, direction, band, np.cumsum(stored) - stored, *ordered)
            position, direction = ordered
        return position.reshape(-1, 3), direction.view(np.uint16).reshape(-1, 2), stored


@entry_kernel
def _count_bands(band, counts):
    """Adds the photons of each band to counts (WAYS, B), in turn: a count that waits for the one before is slower."""
    for k in range(band.size):
        counts[np.uint64(k & (WAYS - 1)), np.uint64(band[k])] += 1
    return counts


@entry_kernel
def _put_in_order(position, direction, band, place, ordered_position, ordered_direction):
    """Copies photons behind those of lower bands, else in the order in which they are; place (B,): of each band's next."""
    for k in range(band.size):
        b = np.uint64(band[k])
        to = np.uint64(place[b])
        place[b] += 1
        ordered_direction[to] = direction[k]
        for axis in range(3):
            ordered_position[np.uint64(3) * to + np.uint64(axis)] = position[3 * k + axis]


def _grown(array: np.ndarray, size: int, used: int) -> np.ndarray:
    """A larger array (size,) with the first `used` values of one that has become too small."""
    larger = np.empty(size, array.dtype)
    larger[:used] = array[:used]
    return larger
