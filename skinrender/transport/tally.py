"""Columns of the integer tally that a walk fills, one row a band.

`names(layers)` lists them; the photons of a band obey, exactly,
``emitted = reflected + transmitted + sides + sum(absorbed) + lost``.
"""

from __future__ import annotations

EMITTED = 0
REFLECTED = 1  # left upwards, specular included
SPECULAR = 2  # the part of `REFLECTED` that never entered
REFLECTED_UNSCATTERED = 3
TRANSMITTED = 4
TRANSMITTED_UNSCATTERED = 5
SIDES = 6
LOST = 7
COLLISIONS_NULL = 8
BORDER_HITS = 9
WAYS = 8  # copies of the tally that the walk counts in, in turn
PER_LAYER = 10  # then absorbed by layer, then scattering events by layer


def columns(layers: int) -> int:
    """Number of columns for a volume of `layers` tissue layers."""
    return PER_LAYER + 2 * layers


def absorbed(layers: int) -> slice:
    """Columns of the photons absorbed in each tissue layer."""
    return slice(PER_LAYER, PER_LAYER + layers)


def scattered(layers: int) -> slice:
    """Columns of the scattering events in each tissue layer."""
    return slice(PER_LAYER + layers, PER_LAYER + 2 * layers)
