"""The point radiance estimate (paper, section 7: the usual one) of a photon map: sample points along the view rays.

For ray q with sample points x_j every ds, spheres of radius r_j that hold about K photons:

    L(q) = (1 - F) / n^2 sum_j ds sum_{i: |x_i - x_j| < r_j} exp(-tau_q(D_i)) p(w_i . -w_q) Phi_i / (V_j c(D_i))

c is the share of a photon's weights that falls on sample points at all (`gather_points.depth_share`). The radii follow
from the map's density at each depth and are fixed before the sum, which keeps rounds independent.
"""

from __future__ import annotations

import numpy as np

from skinrender.estimate.gather_points import depth_share, gather_points
from skinrender.estimate.scatter_image import ScatteredLight, batches_of
from skinrender.estimate.stream import Band, Stream

MARCH_MM = 0.02
WIDEST_MM = 0.1
"""Wider spheres would see past the relief's furrows."""
_SHARE_DEPTHS = 2001


def march_edges(deepest_mm: float) -> np.ndarray:
    """Edges of equal march steps down to a depth."""
    return np.linspace(0.0, deepest_mm, max(1, int(np.ceil(deepest_mm / MARCH_MM))) + 1)


def sphere_radii_mm(stream: Stream, gather_count: int | None) -> np.ndarray:
    """Radius at each march step, (S,), at which a sphere holds `gather_count` photons; between a bin and `WIDEST_MM`."""
    edges = stream.lattice.rays.depth_edges_mm
    depths, photons_per_sample = stream.sampled_depths()
    count = np.histogram(depths, edges)[0] * photons_per_sample
    lx, ly = stream.volume.size_mm
    density = np.maximum(count, 1.0) / (np.diff(edges) * lx * ly)
    radius = np.full(len(density), WIDEST_MM)
    if gather_count is not None:
        radius = np.cbrt(3.0 * gather_count / (4.0 * np.pi * density))
    return np.clip(radius, stream.pixel_lattice.spacing_mm / 2, WIDEST_MM)


def estimate_point(stream: Stream, gather_count: int | None) -> ScatteredLight:
    """Point estimate of the multiply scattered light; the lattice's slabs are the march steps (`march_edges`).

    Parameters
    ----------
    gather_count : photons that a sample point's sphere should hold, on average; None: the widest spheres.
    """
    h, w = stream.shape
    radius = sphere_radii_mm(stream, gather_count)
    batches = batches_of(stream.photon_map.rounds)
    radiance = np.zeros((h, w, stream.photon_map.bands), np.float32)
    y_image = np.zeros((len(batches), h * w), np.float32)
    totals = np.zeros(len(batches))
    seen = 0
    for band in stream.bands():
        y_weight = np.float32(stream.y_weight[band.index])

        def enter(batch: int, image: np.ndarray, y_weight=y_weight) -> None:
            totals[batch] += image.sum(dtype=np.float64)
            y_image[batch] += image * y_weight

        image, count = band.over_batches(batches, _gatherer(stream, band, radius), enter, (h * w,))
        seen += count
        radiance[:, :, band.index] = image.reshape(h, w)
    rounds = np.array([len(batch) for batch in batches])
    scale = stream.photon_map.rounds / rounds
    batch_y = y_image.reshape(-1, h, w) * scale[:, None, None]
    return ScatteredLight(radiance, batch_y, totals * scale / (h * w), rounds, seen / (h * w * stream.lattice.rays.slabs))


def _gatherer(stream: Stream, band: Band, radius: np.ndarray):
    """The function that gathers one round of a band."""
    lattice, rays = stream.pixel_lattice, stream.pixel_lattice.rays
    edges = rays.depth_edges_mm
    step = (np.diff(edges) / (4.0 / 3.0 * np.pi * radius**3))[:, None]
    power = stream.pixel_mean(band.outside_power)[rays.region]
    factor = (power / rays.descent * step).astype(np.float32)
    share = depth_share(edges, radius, np.linspace(0.0, edges[-1], _SHARE_DEPTHS))
    finer = stream.lattice
    fine = None if stream.subpixels == 1 else (finer.to_lattice, finer.bin_start, finer.ray_of, *finer.shape)
    palette, g = band.anisotropy

    def add(index: int, batch: int, image: np.ndarray) -> int:
        return gather_points(
            *band.photons(index), edges, radius, share, fine, band.tau, stream.pixel_of, rays.region,
            lattice.to_lattice, lattice.bounds, lattice.bin_start, lattice.ray_of, rays.point, rays.direction,
            band.pixel_depth, *lattice.shape, palette, stream.volume.z_edges_mm, g, factor, image,
        )  # fmt: skip

    return add
