"""The first zero of a quartic in Bernstein form on [0, 1], isolated by the form's variation-diminishing property."""

from __future__ import annotations

import math

from skinrender.transport import kernel

_TOLERANCE = 1e-11
"""Of the quartic's value at a zero."""
_MAX_LEVEL = 30


@kernel
def first_sign_change(b0, b1, b2, b3, b4):
    """First t in [0, 1] at which the quartic with these Bernstein coefficients turns negative, or -1.

    Dyadic parts are visited from the left; a part without a negative coefficient holds no crossing, one with a
    single change of sign holds exactly one (variation diminishing), any other is halved.
    """
    if b0 < 0.0:
        return 0.0
    if min(min(b1, b2), min(b3, b4)) >= 0.0:
        return -1.0
    index, level = 0, 0
    while True:
        width = math.ldexp(1.0, -level)
        lo = index * width
        c0, c1, c2, c3, c4 = _part(b0, b1, b2, b3, b4, lo, lo + width)
        if c0 < 0.0:
            return lo
        if min(min(min(c0, c1), min(c2, c3)), c4) < 0.0:
            changes = (c0 < 0.0) != (c1 < 0.0)
            changes += (c1 < 0.0) != (c2 < 0.0)
            changes += (c2 < 0.0) != (c3 < 0.0)
            changes += (c3 < 0.0) != (c4 < 0.0)
            if c4 < 0.0 and (changes == 1 or level == _MAX_LEVEL):
                return lo + width * _root(c0, c1, c2, c3, c4)
            if level < _MAX_LEVEL:
                index, level = 2 * index, level + 1
                continue
        index += 1
        while level > 0 and index % 2 == 0:
            index, level = index // 2, level - 1
        if level == 0:
            return -1.0


@kernel
def _root(c0, c1, c2, c3, c4):
    """The root of a quartic in Bernstein form with c0 >= 0 > c4 and one change of sign: Newton, kept in its bracket."""
    lo, hi = 0.0, 1.0
    t = c0 / (c0 - c4)
    for _ in range(100):
        value, slope = _value_and_slope(c0, c1, c2, c3, c4, t)
        # f may start at rounding size and rise before it falls: only a falling zero is the crossing
        if abs(value) <= _TOLERANCE and slope < 0.0:
            break
        if value > 0.0:
            lo = t
        else:
            hi = t
        step = t - value / slope if slope != 0.0 else -1.0
        t = step if lo < step < hi else 0.5 * (lo + hi)
    return t


@kernel
def _value_and_slope(c0, c1, c2, c3, c4, t):
    """Quartic and its derivative at t by de Casteljau's scheme."""
    r = 1.0 - t
    d0, d1, d2, d3 = r * c0 + t * c1, r * c1 + t * c2, r * c2 + t * c3, r * c3 + t * c4
    e0, e1, e2 = r * d0 + t * d1, r * d1 + t * d2, r * d2 + t * d3
    g0, g1 = r * e0 + t * e1, r * e1 + t * e2
    return r * g0 + t * g1, 4.0 * (g1 - g0)


@kernel
def _part(c0, c1, c2, c3, c4, lo, hi):
    """Bernstein coefficients of the same quartic over [lo, hi]."""
    if lo > 0.0:
        c0, c1, c2, c3, c4 = _right_part(c0, c1, c2, c3, c4, lo)
    if hi < 1.0:
        c4, c3, c2, c1, c0 = _right_part(c4, c3, c2, c1, c0, (1.0 - hi) / (1.0 - lo))
    return c0, c1, c2, c3, c4


@kernel
def _right_part(c0, c1, c2, c3, c4, t):
    """Bernstein coefficients over [t, 1]."""
    r = 1.0 - t
    d0, d1, d2, d3 = r * c0 + t * c1, r * c1 + t * c2, r * c2 + t * c3, r * c3 + t * c4
    e0, e1, e2 = r * d0 + t * d1, r * d1 + t * d2, r * d2 + t * d3
    g0, g1 = r * e0 + t * e1, r * e1 + t * e2
    return r * g0 + t * g1, g1, e2, d3, c4
