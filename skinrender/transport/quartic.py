"""The first zero of a quartic in Bernstein form on [0, 1], isolated by the form's variation-diminishing property."""

from __future__ import annotations

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
    index, level, width = 0, 0, 1.0
    while True:
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
                index, level, width = 2 * index, level + 1, 0.5 * width
                continue
        index += 1
        while level > 0 and index % 2 == 0:
            index, level, width = index // 2, level - 1, 2.0 * width
        if level == 0:
            return -1.0


@kernel
def _root(c0, c1, c2, c3, c4):
    """The root of a quartic in Bernstein form with c0 >= 0 > c4 and one change of sign: Halley's steps, kept in their
    bracket."""
    a1, a2 = 4.0 * (c1 - c0), 6.0 * (c2 - 2.0 * c1 + c0)
    a3, a4 = 4.0 * (c3 - c0 + 3.0 * (c1 - c2)), c4 + c0 - 4.0 * (c3 + c1) + 6.0 * c2
    lo, hi = 0.0, 1.0
    t = c0 / (c0 - c4)
    for _ in range(100):
        value = c0 + t * (a1 + t * (a2 + t * (a3 + t * a4)))
        slope = a1 + t * (2.0 * a2 + t * (3.0 * a3 + t * 4.0 * a4))
        # f may start at rounding size and rise before it falls: only a falling zero is the crossing
        if abs(value) <= _TOLERANCE and slope < 0.0:
            break
        if value > 0.0:
            lo = t
        else:
            hi = t
        divisor = slope * slope - value * (a2 + t * (3.0 * a3 + t * 6.0 * a4))
        step = t - value * slope / divisor if divisor > 0.0 else -1.0
        t = step if lo < step < hi else 0.5 * (lo + hi)
    return t


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
