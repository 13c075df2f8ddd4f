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
from skinrender.estimate.guide import guide_bytes, modulations, restore
from skinrender.estimate.kernel_filter import SlabFilter
from skinrender.estimate.radius import COLOR_STEPS, COLOR_WIDER, STEPS, gather_radius_mm, radius_levels
from skinrender.estimate.scatter_image import MOST_BATCHES, ScatteredLight, batches_of
from skinrender.estimate.stream import Band, Stream


def beam_bytes(pixels: int, rays: int, slabs: int, bands: int, rounds: int, threads: int) -> int:
    """What `estimate_beam` holds beside its stream: slab images of batches and threads, worths of rays, the picture."""
    images = 2 * threads + 4  # those of threads are float64
    batches = 4 * min(rounds, MOST_BATCHES)
    return 4 * pixels * (slabs * images + bands + batches) + 16 * rays * slabs + 8 * pixels + guide_bytes(pixels)


def estimate_beam(stream: Stream, gather_count: int | None, guides: np.ndarray | None = None) -> ScatteredLight:
    """Beam estimate of the multiply scattered light.

    Parameters
    ----------
    gather_count : photons that a beam should meet, on average; None: as wide as the tissue allows.
    guides : (K, h, w) of a relief, see `guide`; None where it is flat.
    """
    h, w = stream.shape
    bands = stream.photon_map.bands
    kernels, unit = _choose_kernels(stream, gather_count), stream.power_unit
    batches = batches_of(stream.photon_map.rounds)
    radiance, luminance = np.zeros((h, w, bands), np.float32), np.zeros((h, w))
    noise = _Noise(np.zeros((len(batches), h * w)), np.zeros(len(batches)))
    seen = 0
    for band in stream.bands():
        worth, factor = _ray_weights(stream, band)
        image, count = _deposit_band(stream, band, batches, worth, factor, noise)
        seen += count
        shown = unit * _shown(stream, kernels.luminance, image, factor)
        luminance += stream.y_weight[band.index] * shown
        wider = shown if kernels.color is None else unit * _shown(stream, kernels.color, image, factor)
        radiance[:, :, band.index] = wider
    if kernels.color is not None:
        _scale_luminance(radiance, luminance, stream.y_weight)
    rounds = np.array([len(batch) for batch in batches])
    scale = stream.photon_map.rounds / rounds
    batch_y = unit * scale[:, None, None] * _filtered(kernels.luminance, noise.y_image, (h, w))
    if guides is not None:
        own = unit * noise.y_image.reshape(batch_y.shape)
        restoration = restore(luminance, own.sum(axis=0), modulations(guides, kernels.luminance))
        batch_y = np.array([restoration.batch(*pair) for pair in zip(batch_y, own * scale[:, None, None])])
        radiance *= restoration.factor[:, :, None].astype(np.float32)
    met = seen * kernels.pixels_met / (h * w)
    return ScatteredLight(radiance, batch_y.astype(np.float32), unit * noise.light * scale / (h * w), rounds, met)


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
    depths, photons_per_sample = stream.sampled_depths()
    visible = int(np.sum(depths < rays.depth_edges_mm[-1]) * photons_per_sample)
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

    return np.sum(list(stream.pool.map(part, np.array_split(np.arange(len(images)), stream.threads))), axis=0)


def _filtered(slab_filter: SlabFilter, images: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Slab images (S, h w), filtered, (S, h, w)."""
    return np.array([slab_filter(image.reshape(shape).astype(np.float32)) for image in images]).reshape(-1, *shape)


def _scale_luminance(radiance: np.ndarray, luminance: np.ndarray, y_weight: np.ndarray) -> None:
    """Scale each pixel's spectrum (h, w, B), in place, to a luminance (h, w)."""
    own = radiance @ y_weight
    radiance *= np.divide(luminance, own, out=np.ones_like(own), where=own > 0.0)[:, :, None]


@dataclass(frozen=True, eq=False)
class _Noise:
    """What the photons of each batch show on their own, for the standard error, in the stream's unit of power.

    y_image (batches, pixels): luminance before the filter. It holds all slabs, as one kernel filters them; with the pixel's
    factor inside the filter instead of outside, which matters to the light but not to its noise.
    light (batches,): radiance summed over pixels and bands.
    """

    y_image: np.ndarray
    light: np.ndarray


def _ray_weights(stream: Stream, band: Band) -> tuple[np.ndarray, np.ndarray]:
    """`ray_weights` of a band, each thread some slabs."""
    rays, pixels = stream.lattice.rays, int(np.prod(stream.shape))
    worth = np.empty((band.slabs, len(rays.hit), 2), np.float32)
    factor = np.zeros((band.slabs, pixels), np.float32)
    outside = band.outside_power.astype(np.float32)

    def of_slab(slab: int) -> None:
        ray_weights(
            slab, band.tau, outside[rays.region[slab]], rays.descent, stream.lattice.bin_area, stream.pixel_of, worth, factor
        )  # fmt: skip

    list(stream.pool.map(of_slab, range(band.slabs)))
    return worth, factor


def _deposit_band(
    stream: Stream, band: Band, batches: list[np.ndarray], worth: np.ndarray, factor: np.ndarray, noise: _Noise
) -> tuple[np.ndarray, int]:
    """Slab images (S, pixels) of a band's photons, and the number of contributions; enters their noise.

    A thread takes every n-th batch. The images are float64: a sum in float32 stops growing once it is 2^24 times what is
    added.
    """
    lattice, rays = stream.lattice, stream.lattice.rays
    palette, g = band.anisotropy
    threads = min(stream.threads, len(batches))

    def run(thread: int) -> tuple[np.ndarray, int]:
        image, count = np.zeros(factor.shape), 0
        for k in range(thread, len(batches), threads):
            for index in batches[k]:
                met, light = deposit(
                    *band.photons(index), rays.depth_edges_mm[: band.slabs + 1], rays.region, lattice.to_lattice,
                    lattice.bounds, lattice.only_ray, lattice.bin_start, lattice.ray_of, rays.direction, worth,
                    stream.pixel_of, *lattice.shape, palette, stream.volume.z_edges_mm, g, factor,
                    stream.y_weight[band.index], image, noise.y_image[k],
                )  # fmt: skip
                count += met
                noise.light[k] += light
        return image, count

    done = list(stream.pool.map(run, range(threads)))
    return np.sum([image for image, _ in done], axis=0), sum(count for _, count in done)
