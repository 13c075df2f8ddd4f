"""The point radiance estimate (paper, section 7: the usual one) of a photon map: sample points along the view rays.

For ray q with sample points x_j every ds, spheres of radius r_j that hold about K photons:

    L(q) = (1 - F) / n^2 sum_j ds sum_{i: |x_i - x_j| < r_j} exp(-tau_q(D_i)) p(w_i . -w_i') Phi_i / (V_j c(D_i))

w' is the view ray nearest to the photon (`gather_points.connect_to_own`), c the share of a photon's weights that falls
on sample points at all (`gather_points.depth_share`). The radii follow from the map's density at each depth and are
fixed before the sum, which keeps rounds independent.
"""

from __future__ import annotations

import numpy as np

from skinrender.estimate.gather_points import depth_share, gather_points
from skinrender.estimate.lattice import RayLattice
from skinrender.estimate.scatter_image import MOST_BATCHES, BandsLight, batches_of
from skinrender.estimate.stream import Band, Stream, over_batches

MARCH_MM = 0.02
WIDEST_MM = 0.1
"""Wider spheres would see past the relief's furrows."""
MOST_STEPS = 500
"""Where light reaches deeper than 10 mm, far beyond skin, steps are longer and spheres as wide as they."""
_SHARE_DEPTHS, _SHARE_OF_STEP = 2000, 20


def point_bytes(pixels: int, rays: int, slabs: int, bands: int, rounds: int, threads: int) -> int:
    """What `estimate_point` holds beside its stream: images of batches and threads, factors of rays, the picture."""
    images = min(rounds, MOST_BATCHES) + 9 * threads + 4  # those of threads are float64
    return 4 * pixels * (images + 7 * slabs + bands) + 24 * rays * slabs


def march_edges(deepest_mm: float, side_mm: float = MARCH_MM) -> np.ndarray:
    """Edges of equal march steps down to a depth, no longer than a side of the patch where that can be."""
    return np.linspace(0.0, deepest_mm, int(np.clip(np.ceil(deepest_mm / min(MARCH_MM, side_mm)), 1, MOST_STEPS)) + 1)


def sphere_radii_mm(stream: Stream, pixel_lattice: RayLattice, gather_count: int | None) -> np.ndarray:
    """Radius at each march step, (S,), at which a sphere holds `gather_count` photons; between a bin and `WIDEST_MM`.

    Spheres are never so narrow that photons fall between those of neighboring steps or pixels.
    """
    edges = stream.lattice.rays.depth_edges_mm
    depths, photons_each = stream.depth_sample
    count = np.histogram(depths, edges)[0] * photons_each
    lx, ly = stream.volume.size_mm
    density = np.maximum(count, 1.0) / (np.diff(edges) * lx * ly)
    step = edges[1] - edges[0]
    # spheres wider than the patch would meet the images of each photon in all its periods
    widest = max(min(WIDEST_MM, lx, ly), step)
    radius = np.full(len(density), widest)
    if gather_count is not None:
        radius = np.cbrt(3.0 * gather_count / (4.0 * np.pi * density))
    # across the shorter side of pixels that are drawn out by a grazing view
    pixel = 1.0 / np.linalg.norm(pixel_lattice.to_lattice[0, :, :2], 2)
    narrowest = max(0.5 * pixel, step)  # spheres of half a step would only touch
    return np.clip(radius, narrowest, max(narrowest, widest))


def estimate_point(
    stream: Stream, pixel_lattice: RayLattice, gather_count: int | None, bands: np.ndarray
) -> BandsLight:
    """Point estimate of the multiply scattered light; the lattice's slabs are the march steps (`march_edges`).

    Parameters
    ----------
    pixel_lattice : of one ray a pixel, along which the sample points lie.
    gather_count : photons that a sample point's sphere should hold, on average; None: the widest spheres.
    bands : (n,) those to estimate.
    """
    h, w = stream.shape
    radius = sphere_radii_mm(stream, pixel_lattice, gather_count)
    batches = batches_of(stream.photon_map.rounds)
    radiance = np.zeros((h, w, len(bands)), np.float32)
    y_image = np.zeros((len(batches), h * w), np.float32)
    totals = np.zeros(len(batches))
    seen = 0
    for k, band in enumerate(stream.bands(bands)):
        y_weight = np.float32(stream.y_weight[band.index] * stream.power_unit)

        def enter(batch: int, image: np.ndarray, y_weight=y_weight) -> None:
            totals[batch] += image.sum()
            y_image[batch] += image * y_weight

        image, count = over_batches(stream.pool, batches, _gatherer(stream, pixel_lattice, band, radius), enter, (h * w,))
        seen += count
        radiance[:, :, k] = stream.power_unit * image.reshape(h, w)
    met = seen / stream.lattice.rays.slabs
    return BandsLight(bands, radiance, None, y_image.reshape(-1, h, w), stream.power_unit * totals, met)


def side_share(point: np.ndarray, radius: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """Part of the spheres that lies between the patch's sides, (S, Q) f4; there are no photons beyond.

    Parameters
    ----------
    point : (S, Q, 2), mm, their centers; radius : (S,), mm.
    """
    share = np.ones(point.shape[:2], np.float32)
    for axis, length in enumerate(size_mm):
        for distance in (point[:, :, axis], length - point[:, :, axis]):
            u = np.clip(distance / radius[:, None], 0.0, 1.0)
            share *= 0.25 * (2.0 + u * (3.0 - u * u))  # volume of a ball on one side of a plane
    return share


def _gatherer(stream: Stream, lattice: RayLattice, band: Band, radius: np.ndarray):
    """The function that gathers one round of a band."""
    rays = lattice.rays
    edges = rays.depth_edges_mm
    step = np.diff(edges) / (4.0 / 3.0 * np.pi * radius**3)
    finer = stream.lattice
    worth = band.outside_power[finer.rays.region] / finer.rays.descent
    of_pixels = stream.pixel_mean(worth)
    outside = of_pixels.astype(np.float32)
    if stream.volume.sides != "periodic":
        outside /= side_share(rays.point, radius, stream.volume.size_mm)
    relative = None if stream.subpixels == 1 else _relative(worth, of_pixels[:, stream.pixel_of])
    share = depth_share(
        edges, radius, np.linspace(0.0, edges[-1], max(_SHARE_DEPTHS, _SHARE_OF_STEP * len(radius)) + 1)
    )
    fine = (finer.nearest_ray, finer.to_lattice, *finer.shape, finer.rays.direction, band.tau, stream.pixel_of)
    points, tau = lattice.point_in_bins, band.pixel_depth
    palette, g = band.anisotropy

    def add(index: int, batch: int, image: np.ndarray) -> int:
        return gather_points(
            *band.photons(index), edges, radius, step, share, rays.region, fine, relative, lattice.to_lattice,
            lattice.bounds, lattice.bin_start, lattice.ray_of, points, tau, *lattice.shape, palette,
            stream.volume.z_edges_mm, g, outside, image,
        )  # fmt: skip

    return add


def _relative(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """part / whole as f4, 0 where both are."""
    return np.divide(part, whole, out=np.zeros(part.shape, np.float32), where=whole > 0.0, casting="unsafe")
