"""Single scattering of a uniform sky in a laterally uniform skin: quadrature over the refracted directions.

The result depends on the view ray by its cosine alone, so it is made at a few cosines and interpolated.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.fresnel import fresnel
from skinrender.transport.phase import phase_hg

_VIEW_NODES = 16
_POLAR_NODES = 32
_AZIMUTH_NODES = 32


def sky_single_scattering(cos_view, column, z_edges_mm, z_end_mm, mu_t, mu_s, g, eta) -> np.ndarray:
    """Radiance under the surface per unit radiance of the sky, (Q, B).

    Parameters
    ----------
    cos_view : (Q,) cosines of the refracted view rays; entries <= 0 give 0.
    column : (nz,) palette entries; z_edges_mm : (nz + 1,); z_end_mm : depth at which the region ends.
    mu_t, mu_s, g : (P, B); eta : (B,) n_outside / n_tissue.
    """
    seen = cos_view > 0.0
    result = np.zeros((cos_view.size, eta.size))
    if not seen.any():
        return result
    low, high = float(cos_view[seen].min()), float(cos_view[seen].max())
    count = _VIEW_NODES if high - low > 1e-12 else 1
    unit = np.cos((np.arange(count) + 0.5) * math.pi / count)
    nodes = 0.5 * (high + low) + 0.5 * (high - low) * unit
    edges = np.minimum(np.asarray(z_edges_mm, dtype=float), z_end_mm)
    polar = np.polynomial.legendre.leggauss(_POLAR_NODES)
    values = _at_cosines(nodes, np.ascontiguousarray(column), np.diff(edges), mu_t, mu_s, g, eta, *polar)
    if count == 1:
        result[seen] = values[0]
        return result
    coefficients = np.polynomial.chebyshev.chebfit(unit, values, count - 1)
    result[seen] = np.polynomial.chebyshev.chebval((2.0 * cos_view[seen] - high - low) / (high - low), coefficients).T
    return np.maximum(result, 0.0)


@allocating_kernel
def _at_cosines(cos_view, column, thickness, mu_t, mu_s, g, eta, nodes, weights):
    """The integral over refracted directions and depth at each cosine of the view, (V, B)."""
    result = np.zeros((cos_view.size, eta.size))
    for b in range(eta.size):
        # total reflection bounds the cone inside a denser medium; the square lifts the root at its edge
        lowest = math.sqrt(max(0.0, 1.0 - eta[b] * eta[b]))
        for i in range(nodes.size):
            t = 0.5 * (nodes[i] + 1.0)
            cos_l = lowest + (1.0 - lowest) * t * t
            reflectance, _ = fresnel(cos_l, 1.0 / eta[b])
            share = weights[i] * (1.0 - lowest) * t * 2.0 * math.pi * (1.0 - reflectance) / (eta[b] * eta[b])
            for v in range(cos_view.size):
                result[v, b] += share * _column_integral(cos_view[v], cos_l, column, thickness, mu_t, mu_s, g, b)
    return result


@kernel
def _column_integral(cos_v, cos_l, column, thickness, mu_t, mu_s, g, b):
    """Integral of mu_s p exp(-tau_view - tau_light) over the view ray for one polar angle of the light."""
    total, tau = 0.0, 0.0
    slant = 1.0 / cos_v + 1.0 / cos_l
    last, phase = -1, 0.0
    for k in range(thickness.size):
        entry = column[k]
        if entry != last:
            last, phase = entry, _mean_phase(cos_v, cos_l, g[entry, b])
        rise = mu_t[entry, b] * slant * thickness[k]
        share = -math.expm1(-rise) / rise if rise > 1e-8 else 1.0
        total += math.exp(-tau) * share * mu_s[entry, b] * phase * thickness[k] / cos_v
        tau += rise
        if tau > 40.0:
            break
    return total


@kernel
def _mean_phase(cos_v, cos_l, g):
    """Phase function from light going down at cos_l to a view ray seen from above at cos_v, mean over azimuth."""
    along = -cos_v * cos_l
    across = math.sqrt(max(0.0, (1.0 - cos_v * cos_v) * (1.0 - cos_l * cos_l)))
    total = 0.0
    for m in range(_AZIMUTH_NODES):
        total += phase_hg(along + across * math.cos((m + 0.5) * math.pi / _AZIMUTH_NODES), g)
    return total / _AZIMUTH_NODES
