"""The beam radiance estimate (paper, section 7.2; Jarosz et al. 2008) of a photon map, streamed once in file order.

For ray q, photons i at depth D_i, kernel K taken horizontally at equal depth:

    L(q) = (1 - F) / n^2 sum_i K(|x_q(D_i) - x_i|) exp(-tau_q(D_i)) p(w_i . -w_q) Phi_i / |w_q . grad D|

Bands are walked independently, so each has its own noise, which shows as blotches of color. Where the scene does not ask
for a kernel, the shape of a pixel's spectrum is taken with a wider one than its luminance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinrender.estimate.deposit import deposit, ray_weights
from skinrender.estimate.kernel_filter import SlabFilter
from skinrender.estimate.radius import COLOR_STEPS, COLOR_WIDER, STEPS, gather_radius_mm, radius_levels
from skinrender.estimate.scatter_image import MOST_BATCHES, BandsLight, batches_of
from skinrender.estimate.stream import Band, Stream

_PARTS = 8
"""Parts that slab images are filtered in side by side: their number is fixed, as sums round by their order."""


def beam_bytes(pixels: int, rays: int, slabs: int, bands: int, rounds: int, threads: int) -> int:
    """What `estimate_beam` holds beside its stream: slab images of batches and threads, worths of rays, the picture."""
    images = min(rounds, MOST_BATCHES) + 6 * threads + 4  # those of threads are float64
    return 4 * pixels * (slabs * images + bands) + 16 * rays * slabs + 8 * pixels


def estimate_beam(stream: Stream, gather_count: int | None, bands: np.ndarray) -> BandsLight:
    """Beam estimate of the multiply scattered light.

    Parameters
    ----------
    gather_count : photons that a beam should meet, on average; None: as wide as the tissue allows.
    bands : (n,) those to estimate.
    """
    h, w = stream.shape
    slabs = stream.lattice.rays.slabs
    kernels, unit = _choose_kernels(stream, gather_count), stream.power_unit
    batches = batches_of(stream.photon_map.rounds)
    radiance = np.zeros((h, w, len(bands)), np.float32)
    luminance = None if kernels.color is None else np.zeros((h, w, len(bands)))
    y_image = np.zeros((len(batches), slabs, h * w), np.float32)
    totals = np.zeros(len(batches))
    seen = 0
    for k, band in enumerate(stream.bands(bands)):
        visible = slice(0, band.slabs + 1)
        worth, factor = ray_weights(
            band.tau[visible], band.outside_power, stream.lattice.rays.region, stream.lattice.rays.descent,
            stream.lattice.bin_area, stream.pixel_of, h * w,
        )  # fmt: skip
        noise = _Noise(factor, np.float32(stream.y_weight[band.index] * unit), y_image, totals)
        add = _depositor(stream, band, worth)
        image, count = band.over_batches(batches, add, noise.add, (band.slabs, h * w))
        seen += count
        shown = unit * _shown(stream, kernels.luminance, image, factor)
        if luminance is not None:
            luminance[:, :, k] = stream.y_weight[band.index] * shown
            shown = unit * _shown(stream, kernels.color, image, factor)
        radiance[:, :, k] = shown
    batch_y = np.array([_filtered(kernels.luminance, images, (h, w)).sum(axis=0) for images in y_image])
    return BandsLight(bands, radiance, luminance, batch_y, unit * totals, seen * kernels.pixels_met)


@dataclass(frozen=True, eq=False)
class _Kernels:
    """What slab images are filtered with, for the luminance and for the shape of the spectra (None: the same).

    pixels_met: pixels within the luminance's kernel, on average.
    """

    luminance: SlabFilter
    color: SlabFilter | None
    pixels_met: float


def _choose_kernels(stream: Stream, gather_count: int | None) -> _Kernels:
    rays, volume, (h, w) = stream.lattice.rays, stream.volume, stream.shape
    depths, photons_each = stream.depth_sample
    visible = int(np.sum(depths < rays.depth_edges_mm[-1]) * photons_each)
    widest = gather_radius_mm(gather_count, visible, volume.size_mm)
    spacing = stream.lattice.spacing_mm * stream.subpixels
    entry = stream.pixel_mean(rays.entry.T)[:2].T
    inside = stream.pixel_mean(rays.hit.astype(np.float32)).reshape(h, w)

    def slab_filter(widest_mm: float, steps: tuple[float, ...]) -> SlabFilter:
        return SlabFilter(*radius_levels(volume, entry, (h, w), spacing, widest_mm, steps), inside, stream.covers_patch)

    luminance = slab_filter(widest, STEPS)
    one_kernel = gather_count is not None or stream.photon_map.bands == 1
    color = None if one_kernel else slab_filter(COLOR_WIDER * widest, COLOR_STEPS)
    return _Kernels(luminance, color, float(np.mean(np.maximum(1.0, np.pi * luminance.radius**2))))


def _shown(stream: Stream, slab_filter: SlabFilter, images: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Sum over the slabs of the filtered images (S, h w) times the pixels' factors (S, h w), as (h, w)."""

    def part(slabs: np.ndarray) -> np.ndarray:
        factors = factor[slabs].reshape(-1, *stream.shape)
        return np.einsum("sij,sij->ij", _filtered(slab_filter, images[slabs], stream.shape), factors)

    parts = np.array_split(np.arange(len(images)), min(_PARTS, len(images)))
    return np.sum(list(stream.pool.map(part, parts)), axis=0)


def _filtered(slab_filter: SlabFilter, images: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Slab images (S, h w), filtered, (S, h, w)."""
    return np.array([slab_filter(image.reshape(shape).astype(np.float32)) for image in images]).reshape(-1, *shape)


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
        self.totals[batch] += shown.sum()
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
