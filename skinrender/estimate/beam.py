"""The beam radiance estimate (paper, section 7.2; Jarosz et al. 2008) of a photon map, streamed once in file order.

For ray q, photons i at depth D_i, kernel K taken horizontally at equal depth:

    L(q) = (1 - F) / n^2 sum_i K(|x_q(D_i) - x_i|) exp(-tau_q(D_i)) p(w_i . -w_q) Phi_i / |w_q . grad D|
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinrender.estimate.deposit import deposit, ray_weights
from skinrender.estimate.kernel_filter import SlabFilter
from skinrender.estimate.radius import gather_radius_mm, radius_levels
from skinrender.estimate.scatter_image import ScatteredLight, batches_of
from skinrender.estimate.stream import Band, Stream


def estimate_beam(stream: Stream, gather_count: int | None) -> ScatteredLight:
    """Beam estimate of the multiply scattered light.

    Parameters
    ----------
    gather_count : photons that a beam should meet, on average; None: as wide as the tissue allows.
    """
    rays, volume, (h, w) = stream.lattice.rays, stream.volume, stream.shape
    spacing = stream.lattice.spacing_mm * stream.subpixels
    depths, photons_per_sample = stream.sampled_depths()
    visible = int(np.sum(depths < rays.depth_edges_mm[-1]) * photons_per_sample)
    radius = gather_radius_mm(gather_count, visible, volume.size_mm)
    entry = stream.pixel_mean(rays.entry.T)[:2].T
    level, radii = radius_levels(volume, entry, stream.shape, spacing, radius)
    inside = stream.pixel_mean(rays.hit.astype(np.float32)).reshape(h, w)
    slab_filter = SlabFilter(level, radii, inside, stream.covers_patch)

    def filtered(images: np.ndarray) -> np.ndarray:
        return np.array([slab_filter(image.reshape(h, w)) for image in images])

    batches = batches_of(stream.photon_map.rounds)
    radiance = np.zeros((h, w, stream.photon_map.bands), np.float32)
    y_image = np.zeros((len(batches), rays.slabs, h * w), np.float32)
    totals = np.zeros(len(batches))
    seen = 0
    for band in stream.bands():
        visible = slice(0, band.slabs + 1)
        worth, factor = ray_weights(
            band.tau[visible], band.pixel_depth[visible], band.outside_power, rays.region, rays.descent,
            stream.lattice.bin_area, stream.pixel_of,
        )  # fmt: skip
        noise = _Noise(factor, np.float32(stream.y_weight[band.index]), y_image, totals)
        add = _depositor(stream, band, worth)
        image, count = band.over_batches(batches, add, noise.add, (band.slabs, h * w))
        seen += count
        slabs = np.array_split(image, stream.threads)
        shown = np.concatenate(list(stream.pool.map(filtered, slabs))).reshape(factor.shape)
        radiance[:, :, band.index] = np.einsum("sq,sq->q", shown, factor).reshape(h, w)
    rounds = np.array([len(batch) for batch in batches])
    scale = stream.photon_map.rounds / rounds
    batch_y = np.array([filtered(images).sum(axis=0) for images in y_image]) * scale[:, None, None]
    met = np.mean(np.maximum(1.0, np.pi * radii[level] ** 2))
    return ScatteredLight(radiance, batch_y, totals * scale / (h * w), rounds, seen * met / (h * w))


@dataclass(frozen=True, eq=False)
class _Noise:
    """Enters each batch's slab images on their own, for the standard error.

    factor (S, pixels) and y_weight of the band; y_image (batches, S, pixels) f4 and totals (batches,) are added to.
    """

    factor: np.ndarray
    y_weight: np.float32
    y_image: np.ndarray
    totals: np.ndarray

    def add(self, batch: int, image: np.ndarray) -> None:
        shown = image * self.factor
        self.totals[batch] += shown.sum(dtype=np.float64)
        shown *= self.y_weight
        self.y_image[batch, : len(shown)] += shown


def _depositor(stream: Stream, band: Band, worth: np.ndarray):
    """The function that deposits one round of a band."""
    lattice, rays = stream.lattice, stream.lattice.rays
    palette, g = band.anisotropy

    def add(index: int, batch: int, image: np.ndarray) -> int:
        return deposit(
            *band.photons(index), rays.depth_edges_mm[: band.slabs + 1], rays.region, lattice.to_lattice, lattice.bounds,
            lattice.only_ray, lattice.bin_start, lattice.ray_of, rays.direction, worth, stream.pixel_of, *lattice.shape,
            palette, stream.volume.z_edges_mm, g, image,
        )  # fmt: skip

    return add
