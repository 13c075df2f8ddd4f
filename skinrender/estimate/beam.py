"""The beam radiance estimate (paper, section 7.2; Jarosz et al. 2008) of a photon map, streamed once in file order.

For ray q, photons i at depth D_i, kernel K taken horizontally at equal depth:

    L(q) = (1 - F) / n^2 sum_i K(|x_q(D_i) - x_i|) exp(-tau_q(D_i)) p(w_i . -w_q) Phi_i / |w_q . grad D|

Bands are walked independently, so each has its own noise, which shows as blotches of color. Where the scene does not ask
for a kernel, the shape of a pixel's spectrum is taken with a wider one than its luminance; what it flattens is restored in
each band.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from skinrender.estimate.deposit import deposit, ray_weights
from skinrender.estimate.guide import Flattened, Guides, guide_bytes, restore
from skinrender.estimate.kernel_filter import SlabFilter
from skinrender.estimate.radius import COLOR_WIDER, gather_radius_mm, in_pixels, radius_levels
from skinrender.estimate.scatter_image import MOST_BATCHES, BandsLight, batches_of
from skinrender.estimate.stream import Band, Stream

_PARTS = 8
"""Parts, at most, in which photons are deposited and images filtered side by side: as many for any number of threads,
since the order of a sum decides how it is rounded."""
_CELLS_PER_PHOTON = 32
"""Cells of an image that are cleared and summed in the time that a photon takes."""


def beam_bytes(pixels: int, rays: int, slabs: int, bands: int, rounds: int) -> int:
    """What `estimate_beam` holds beside its stream: slab images, worths of rays, luminance of batches, the picture."""
    images = 2 * (_PARTS + 1) + 4  # those of parts are float64
    batches = 4 * min(rounds, MOST_BATCHES)
    return 4 * pixels * (slabs * images + 5 * bands + batches) + 16 * rays * slabs + 8 * pixels + guide_bytes(pixels)


def estimate_beam(
    stream: Stream, gather_count: int | None, bands: np.ndarray, guides: Guides | None = None
) -> BandsLight:
    """Beam estimate of the multiply scattered light.

    Parameters
    ----------
    gather_count : photons that a beam should meet, on average; None: as wide as the tissue allows.
    bands : (n,) those to estimate.
    guides : see `guide`; None where there are none.
    """
    h, w = stream.shape
    kernels, unit = _choose_kernels(stream, gather_count), stream.power_unit
    batches = batches_of(stream.photon_map.rounds)
    radiance = np.zeros((h, w, len(bands)), np.float32)
    luminance = None if kernels.color is None else np.zeros((h, w, len(bands)))
    restores_color = luminance is not None and guides is not None and len(guides.color) + len(guides.sides) > 0
    changes = guides.of_color(kernels.color) if restores_color else None
    noise = _Noise(np.zeros((len(batches), h * w)), np.zeros(len(batches)))
    noisy = None if guides is None else np.zeros((h, w, len(bands)))
    images = np.empty((min(_PARTS, len(batches)), stream.lattice.rays.slabs, h * w))
    seen = 0
    for k, (band, worth, factor) in enumerate(_weighted_bands(stream, bands)):
        image, count = _deposit_band(stream, band, batches, worth, factor, noise, images)
        seen += count
        shown = unit * _shown(stream, kernels.luminance, image, factor)
        if luminance is not None:
            luminance[:, :, k] = stream.y_weight[band.index] * shown
            shown = unit * _shown(stream, kernels.color, image, factor)
        if noisy is not None:
            unfiltered = unit * np.einsum("sp,sp->p", image, factor).reshape(h, w)
            noisy[:, :, k] = stream.y_weight[band.index] * unfiltered
            if changes is not None:
                shown *= restore(shown, unfiltered, changes).factor
        radiance[:, :, k] = shown
    batch_y = (unit * _filtered(kernels.luminance, noise.y_image, (h, w))).astype(np.float32)
    flattened = None
    if guides is not None:
        of_batches = (unit * noise.y_image).astype(np.float32).reshape(batch_y.shape)
        flattened = Flattened(noisy, of_batches, guides.of_luminance(kernels.luminance))
    return BandsLight(bands, radiance, luminance, batch_y, unit * noise.light, seen * kernels.pixels_met, flattened)


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

    luminance = SlabFilter(*radius_levels(volume, entry, (h, w), spacing, widest), inside, stream.covers_patch)
    color = None
    if gather_count is None and stream.photon_map.bands > 1:
        radius = np.array([in_pixels(COLOR_WIDER * widest, spacing)])
        color = SlabFilter(np.zeros((h, w), np.int32), radius, inside, stream.covers_patch)
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
    """What the photons of each batch show on their own, for the standard error, in the stream's unit of power.

    y_image (batches, pixels): luminance before the filter. It holds all slabs, as one kernel filters them; with the pixel's
    factor inside the filter instead of outside, which matters to the light but not to its noise.
    light (batches,): radiance summed over pixels and bands.
    """

    y_image: np.ndarray
    light: np.ndarray


def _weighted_bands(stream: Stream, bands: np.ndarray) -> Iterator[tuple[Band, np.ndarray, np.ndarray]]:
    """Each band with its `ray_weights`; they are made while the band before is summed, which leaves threads idle.

    The weights of a band are gone when the next but one is asked for: fresh memory for each costs the system as much. Its
    `tau` is that of another band already.
    """
    rays = stream.lattice.rays
    rooms = np.empty((2, rays.slabs, len(rays.hit), 2), np.float32)
    before = None
    for k, band in enumerate(stream.bands(bands)):
        weighted, finish = _begin_weights(stream, band, rooms[k % 2, : band.slabs])
        if before is not None:
            yield before
        finish()
        before = weighted
    if before is not None:
        yield before


def _begin_weights(
    stream: Stream, band: Band, worth: np.ndarray
) -> tuple[tuple[Band, np.ndarray, np.ndarray], Callable[[], object]]:
    """A band with arrays that its `ray_weights` fill, each thread some slabs, and the function that waits for them."""
    rays, pixels = stream.lattice.rays, int(np.prod(stream.shape))
    factor = np.zeros((band.slabs, pixels), np.float32)
    outside = band.outside_power.astype(np.float32)

    def of_slab(slab: int) -> None:
        transmittance = np.exp(np.float32(-0.5) * (band.tau[slab] + band.tau[slab + 1]))
        ray_weights(
            slab, band.tau, transmittance, outside[rays.region[slab]], rays.descent, stream.lattice.bin_area,
            stream.pixel_of, worth, factor,
        )  # fmt: skip

    begun = [stream.pool.submit(of_slab, slab) for slab in range(band.slabs)]
    return (band, worth, factor), lambda: [one.result() for one in begun]


def _deposit_band(
    stream: Stream, band: Band, batches: list[np.ndarray], worth: np.ndarray, factor: np.ndarray, noise: _Noise,
    images: np.ndarray,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """Slab images (S, pixels) of a band's photons, and the number of contributions; enters their noise.

    The batches are shared out to a fixed number of images, so that the sum is the same for any number of threads. They
    are float64: a sum in float32 stops growing once it is 2^24 times what is added. images : room for theirs, of which the
    first becomes the sum.
    """
    lattice, rays = stream.lattice, stream.lattice.rays
    palette, g = band.anisotropy
    images = images[: _parts_of(band, images[0, : band.slabs].size)]

    def run(part: int) -> int:
        image, count = images[part, : band.slabs], 0
        image[...] = 0.0
        for k in range(part, len(batches), len(images)):
            for index in batches[k]:
                met, light = deposit(
                    *band.photons(index), rays.depth_edges_mm[: band.slabs + 1], rays.region, lattice.to_lattice,
                    lattice.bounds, lattice.only_ray, lattice.bin_start, lattice.ray_of, rays.direction, worth,
                    stream.pixel_of, *lattice.shape, palette, stream.volume.z_edges_mm, g, factor,
                    stream.y_weight[band.index], image, noise.y_image[k],
                )  # fmt: skip
                count += met
                noise.light[k] += light
        return count

    count = sum(stream.pool.map(run, range(len(images))))
    total = images[0, : band.slabs]
    for image in images[1:]:
        total += image[: band.slabs]
    return total, count


def _parts_of(band: Band, cells: int) -> int:
    """Parts in which a band's photons are deposited soonest, each into an image of its own: for few photons, few."""
    return max(1, round(math.sqrt(_CELLS_PER_PHOTON * band.stored / cells)))
