"""The Henyey-Greenstein phase function: its value and its sampler, free of special cases for any |g| < 1.

Directions are directions of flight: cos(theta) = +1 is forward. Source: Henyey & Greenstein, ApJ 93, 70 (1941).
"""

from __future__ import annotations

import math

from skinrender.transport import kernel


@kernel
def phase_hg(cos_theta, g):
    """Value per steradian at the cosine between the flights before and after; its integral over the sphere is 1."""
    # (1-|g|)^2 + 2|g|(1 -+ cos) instead of 1 + g^2 - 2 g cos: no cancellation in the peak of a strongly forward g
    # and never below 0: a cosine rounded beyond 1 would make the root of a negative number of it
    away = max(0.0, 1.0 - cos_theta if g >= 0.0 else 1.0 + cos_theta)
    strength = abs(g)
    base = (1.0 - strength) * (1.0 - strength) + 2.0 * strength * away
    return (1.0 - g) * (1.0 + g) / (4.0 * math.pi * base * math.sqrt(base))


@kernel
def sample_hg(g, u):
    """1 - cos(theta) of a Henyey-Greenstein turn for a uniform variate u in [0, 1]; exact at g = 0 and near |g| = 1."""
    denominator = 1.0 - g + 2.0 * g * u
    s = (1.0 - g) * (1.0 + g) / denominator
    return (1.0 - g) * (1.0 - u) * (s + 1.0 - g) / denominator
