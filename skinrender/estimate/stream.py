"""Streaming a photon map past the view rays, band by band: what the beam and the point estimate share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from skinrender.estimate.pixel_rays import PixelRays
from skinrender.estimate.ray_paths import VISIBLE_DEPTH
from skinrender.estimate.transmittance import Crossings
from skinrender.estimate.view_path import relief_arrays
from skinrender.photonmap.photon_map import PhotonMap

_SAMPLE = 200_000


class DepthSample(NamedTuple):
    """Depths of an even sample of a map's photons, and how many photons each stands for: what gather radii come
    from."""

    z_mm: np.ndarray
    photons_each: float


def sample_depths(photon_map: PhotonMap) -> DepthSample:
    """Depths below the mean surface of an even sample of the photons."""
    step = max(1, len(photon_map) // _SAMPLE)
    return DepthSample(photon_map.depths(step), float(step))


@dataclass(frozen=True, eq=False)
class Stream(PixelRays):
    """A photon map seen by the rays of a picture.

    Parameters
    ----------
    crossings : what the lattice's rays meet.
    y_weight : (B,) luminance of one W mm^-2 sr^-1 in each band.
    pool : threads; the kernels release the interpreter lock.
    progress : called with the number of photons done.
    """

    crossings: Crossings
    photon_map: PhotonMap
    depth_sample: DepthSample
    y_weight: np.ndarray
    pool: ThreadPoolExecutor
    progress: Callable[[int], None]

    def bands(self, bands: np.ndarray) -> Iterator[Band]:
        """Each of some bands with its optical depths along the rays.

        The depths of a band are gone when the next is asked for: all have the same room, as the system takes as long to
        give fresh memory as the depths take to compute.
        """
        volume, rays = self.volume, self.lattice.rays
        tau = np.zeros((rays.slabs + 1, len(rays.hit)), np.float32)
        for band in bands:
            self.crossings.optical_depths(volume.mu_a[:, band] + volume.mu_s[:, band], self.pool, tau)
            yield Band(self, int(band), tau)
            self.progress(self.stored(band))
            self.photon_map.forget_pages()

    @cached_property
    def relief(self) -> np.ndarray | None:
        """Control points of the surface, None when flat."""
        return None if self.volume.surface_mm is None else relief_arrays(self.volume.surface_mm)[0]

    @cached_property
    def power_unit(self) -> float:
        """W of the strongest photon: images are made in this unit, so that light of any power fits into float32."""
        return float(self.photon_map.power_per_band.max()) or 1.0

    def stored(self, band: int) -> int:
        """Photons of a band in all rounds."""
        slices = (self.photon_map.band_slice(index, band) for index in range(self.photon_map.rounds))
        return sum(part.stop - part.start for part in slices)


@dataclass(frozen=True, eq=False)
class Band:
    """One band of a stream.

    Parameters
    ----------
    index : of the band.
    tau : (S + 1, Q) f4, optical depth of the rays at the slab edges.
    """

    stream: Stream
    index: int
    tau: np.ndarray

    @cached_property
    def anisotropy(self) -> tuple[np.ndarray | None, np.ndarray]:
        """(palette volume or None, g (P,)): None when all tissue has the same g."""
        volume = self.stream.volume
        g = np.ascontiguousarray(volume.g[:, self.index])
        used = g[volume.palette_layer > 0]
        return (None, used[:1].copy()) if np.ptp(used) == 0.0 else (volume.tissue_index, g)

    @cached_property
    def keep(self) -> np.ndarray | None:
        """Roulette table of the band: bins per mm and keep probabilities; None when all were kept."""
        return roulette_table(self.stream.photon_map, self.index)

    @cached_property
    def slabs(self) -> int:
        """Slabs within the visible depth of this band; light from below them is less than 0.02 %."""
        hit = self.stream.lattice.rays.hit
        clearest = (self.tau if hit.all() else self.tau[:, hit]).min(axis=1, initial=np.inf)
        return max(1, int(np.searchsorted(clearest[:-1], VISIBLE_DEPTH)))

    @property
    def stored(self) -> int:
        """Its photons in all rounds."""
        return self.stream.stored(self.index)

    @cached_property
    def outside_power(self) -> np.ndarray:
        """Power of a photon (in `power_unit`) times the factor from radiance inside a region to that outside, (R,
        Q)."""
        rays = self.stream.lattice.rays
        power = self.stream.photon_map.power_per_band[self.index] / self.stream.power_unit
        outside = rays.transmission[:, :, self.index] * power
        return np.where(rays.hit, outside, 0.0)

    @cached_property
    def pixel_depth(self) -> np.ndarray:
        """Optical depth at the slab edges that gives each pixel's mean transmittance, (S + 1, h w) f4."""
        if self.stream.subpixels == 1:
            return self.tau
        return -np.log(np.maximum(self.stream.pixel_mean(np.exp(-self.tau)), np.float32(1e-30)))

    def photons(self, index: int) -> tuple:
        """Photons of one round as the kernels take them: position, direction, first, last, roulette, geometry."""
        s = self.stream
        part = s.photon_map.band_slice(int(index), self.index)
        lx, ly = s.volume.size_mm
        return (
            s.photon_map.position, s.photon_map.direction, part.start, part.stop, self.keep,
            float(s.volume.z_edges_mm[0]), lx, ly, s.volume.sides == "periodic", s.relief,
        )  # fmt: skip


def roulette_table(photon_map: PhotonMap, band: int) -> np.ndarray | None:
    """Roulette table of a band as the kernels read it: bins per mm, then keep probabilities; None when all were
    kept."""
    if photon_map.keep_probability is None:
        return None
    bins_per_mm = 1.0 / (photon_map.depth_edges_mm[1] - photon_map.depth_edges_mm[0])
    return np.concatenate([[bins_per_mm], photon_map.keep_probability[band]]).astype(np.float64)


def over_batches(
    pool: ThreadPoolExecutor, batches: list[np.ndarray], add: Callable, enter: Callable, shape: tuple[int, ...]
) -> tuple[np.ndarray, int]:
    """Run ``add(round, batch, image)`` over the rounds of each batch, then ``enter(batch, image)``.

    Batches are summed in their order, so that the result is the same for any number of threads. The images are float64:
    a sum in float32 stops growing once it is 2^24 times what is added. Returns the sum of the batches' images and of
    the counts that `add` returned.
    """
    total, count, free = np.zeros(shape), 0, []

    def run(k: int) -> tuple[np.ndarray, int]:
        image = free.pop() if free else np.empty(shape)
        image[:] = 0.0
        met = sum(add(int(index), k, image) for index in batches[k])
        enter(k, image)
        return image, met

    for image, met in pool.map(run, range(len(batches))):
        total += image
        count += met
        free.append(image)
    return total, count
