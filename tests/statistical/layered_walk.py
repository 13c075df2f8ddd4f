"""A plain walk through flat layers, one photon at a time in double precision, for comparison.

It shares nothing with the package: layers are crossed step by step, with a new free path after each border (as MCML
does: Wang, Jacques and Zheng 1995), Henyey-Greenstein by its textbook inverse, Fresnel by angles.
"""

from __future__ import annotations

import math

import numba
import numpy as np

REFLECTED, TRANSMITTED, PER_LAYER = 0, 1, 2  # then absorbed by layer, then scattering events by layer


@numba.njit
def reflectance(cosine, n_from, n_to):
    """Unpolarized Fresnel reflectance and the cosine beyond the border."""
    if n_from == n_to:
        return 0.0, cosine
    if cosine > 1.0 - 1e-12:
        return ((n_from - n_to) / (n_from + n_to)) ** 2, cosine
    inside = math.acos(cosine)
    sine = math.sin(inside) * n_from / n_to
    if sine >= 1.0:
        return 1.0, 0.0
    beyond = math.asin(sine)
    plus, minus = inside + beyond, inside - beyond
    return 0.5 * ((math.sin(minus) / math.sin(plus)) ** 2 + (math.tan(minus) / math.tan(plus)) ** 2), math.cos(beyond)


@numba.njit
def scattered_cosine(rng, uz, g):
    """Vertical cosine after a scattering; the azimuth about the old direction is even."""
    xi = rng.random()
    cosine = 2.0 * xi - 1.0
    if abs(g) > 1e-6:
        ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * xi)
        cosine = (1.0 + g * g - ratio * ratio) / (2.0 * g)
    cosine = min(1.0, max(-1.0, cosine))
    across = math.sqrt((1.0 - cosine * cosine) * max(0.0, 1.0 - uz * uz))
    return min(1.0, max(-1.0, uz * cosine + across * math.cos(2.0 * math.pi * rng.random())))


@numba.njit
def walk(borders, mu_a, mu_s, g, n, diffuse, histories, rng):
    """Counts of each fate, and sums of squares of the counts of one history.

    borders (L + 1,) mm; mu_a, mu_s (1/mm), g (L,); n (L + 2,) from above to below; rng a `numpy.random.Generator`.
    """
    layers = mu_a.size
    counts, squares = np.zeros(PER_LAYER + 2 * layers), np.zeros(PER_LAYER + 2 * layers)
    own = np.zeros(counts.size)
    for _ in range(histories):
        own[:] = 0.0
        uz = math.sqrt(1.0 - rng.random()) if diffuse else 1.0
        layer, z = -1, borders[0]
        while True:
            if layer >= 0:
                mu_t = mu_a[layer] + mu_s[layer]
                free = -math.log(1.0 - rng.random()) / mu_t if mu_t > 0.0 else math.inf
                edge = borders[layer + 1] if uz > 0.0 else borders[layer]
                if uz == 0.0 or free * abs(uz) < abs(edge - z):
                    z += free * uz
                    if rng.random() * mu_t < mu_a[layer]:
                        own[PER_LAYER + layer] += 1.0
                        break
                    own[PER_LAYER + layers + layer] += 1.0
                    uz = scattered_cosine(rng, uz, g[layer])
                    continue
                z = edge
            other = layer + 1 if uz > 0.0 else layer - 1
            reflected, beyond = reflectance(abs(uz), n[layer + 1], n[other + 1])
            if rng.random() < reflected:
                uz = -uz
                other = layer
            else:
                uz = math.copysign(beyond, uz)
            if other < 0:
                own[REFLECTED] = 1.0
                break
            if other == layers:
                own[TRANSMITTED] = 1.0
                break
            layer = other
        counts += own
        squares += own * own
    return counts, squares
