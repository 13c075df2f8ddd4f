"""Transmittance along the view rays (paper, section 7.2): optical depth voxel by voxel, from the entry point inwards.

The rays are followed through the voxels once; what they meet is kept, and every band's optical depths are sums over it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skinrender.estimate.ray_paths import VISIBLE_DEPTH, RayPaths
from skinrender.photonmap.first_scattering import is_laterally_uniform
from skinrender.skin.volume import SkinVolume
from skinrender.transport import allocating_kernel, entry_kernel, inlined_kernel
from skinrender.transport.optical_depth import for_each_stretch

_DEEPEST = 3 * VISIBLE_DEPTH
"""Optical depth of all bands beyond which a ray is not followed."""
_ANY_WIDTH_MM = 1e30


class Stretches(NamedTuple):
    """What the rays from `first` on meet; n stretches in all, in their order.

    entry (n,) int32, palette entry, or P: opaque; path (n,) f4, mm; count (rays, S) int32, stretches in each slab.
    """

    first: int
    entry: np.ndarray
    path: np.ndarray
    count: np.ndarray


@dataclass(frozen=True, eq=False)
class Crossings:
    """The tissue that Q view rays cross in S slabs; `parts`: of the rays, in order."""

    parts: list[Stretches]

    def optical_depths(self, mu_t: np.ndarray, pool: ThreadPoolExecutor, depth: np.ndarray) -> np.ndarray:
        """Optical depth of every ray at the slab edges, into depth (S + 1, Q) f4, whose first row is 0.

        mu_t (P,) : extinction of a band, 1/mm.
        """
        mu_t = np.append(mu_t, 1.0)
        list(pool.map(lambda part: add_up(*part, mu_t, depth), self.parts))
        return depth


def cross_voxels(rays: RayPaths, volume: SkinVolume, threads: int) -> Crossings:
    """Follow the rays through the voxels of a volume."""
    palette_index, (lx, ly) = volume.tissue_index, volume.size_mm
    if is_laterally_uniform(palette_index):  # one column without sides: a level ray may cross a million periods
        palette_index, lx, ly = palette_index[:1, :1], _ANY_WIDTH_MM, _ANY_WIDTH_MM
    clearest = (volume.mu_a + volume.mu_s).min(axis=1)
    longest = 1.001 * _DEEPEST / max(clearest[volume.palette_layer > 0].min(), 1e-30)
    bounds = np.linspace(0, len(rays.hit), 2 * threads + 1).astype(int)

    def follow(k: int) -> Stretches:
        return Stretches(int(bounds[k]), *record_stretches(
            palette_index, volume.z_edges_mm, lx, ly, clearest, rays.entry, rays.direction, rays.region, rays.path_edges,
            rays.hit, _DEEPEST, longest, bounds[k], bounds[k + 1],
        ))  # fmt: skip

    with ThreadPoolExecutor(threads) as pool:
        return Crossings(list(pool.map(follow, range(len(bounds) - 1))))


def crossings_bytes(rays: int, slabs: int) -> int:
    """Size in memory of `Crossings` and of a band's optical depths, with two stretches a slab: in skin there are 1.4."""
    return rays * (2 * 8 * slabs + 4 * slabs + 4 * (slabs + 1))


@inlined_kernel
def _record(sink, entry, run):
    entries, paths, state = sink
    n = state[0]
    entries[n], paths[n] = entry, run
    state[0] = n + 1


_record_each = for_each_stretch(_record)


@allocating_kernel
def record_stretches(
    palette_index, z_edges, lx, ly, clearest, entry, direction, region, path_edges, hit, deepest, longest, first, last
):
    """Members `entry`, `path` and `count` of `Stretches` of the rays first..last-1.

    clearest (P,) : least extinction of any band, 1/mm. Beyond `deepest` of it a slab is one opaque stretch; no flight of
    `longest` mm is less deep, so that a level ray, which may fly through a slab for meters, is followed no further: the rest of
    the slab is taken to be like what was seen, as optical depth is interpolated within slabs.
    """
    slabs, (nx, ny, nz) = path_edges.shape[0] - 1, palette_index.shape
    entries, paths = np.empty(64 * (last - first), np.int32), np.empty(64 * (last - first), np.float32)
    count, state = np.zeros((last - first, slabs), np.int32), np.zeros(1, np.int64)
    for q in range(first, last):
        x, y, z = entry[q, 0], entry[q, 1], entry[q, 2]
        tau = 0.0
        for s in range(slabs if hit[q] else 0):
            ux, uy, uz = direction[region[s], q, 0], direction[region[s], q, 1], direction[region[s], q, 2]
            length = path_edges[s + 1, q] - path_edges[s, q]
            start = state[0]
            seen = min(length, longest)
            room = start + nz + 8 + int(seen * (abs(ux) * nx / lx + abs(uy) * ny / ly))
            if room > entries.size:
                entries, paths = _grown(entries, 2 * room), _grown(paths, 2 * room)
            if tau < deepest:
                _record_each(palette_index, z_edges, lx, ly, x, y, z, ux, uy, uz, seen, (entries, paths, state))
                for k in range(start, state[0]):
                    tau += clearest[entries[k]] * paths[k]
                    paths[k] *= length / seen
            else:
                _record((entries, paths, state), clearest.size, deepest)
            count[q - first, s] = state[0] - start
            x, y, z = x + length * ux, y + length * uy, z + length * uz
    return entries[: state[0]].copy(), paths[: state[0]].copy(), count


@allocating_kernel
def _grown(array, size):
    grown = np.empty(size, array.dtype)
    grown[: array.size] = array
    return grown


@entry_kernel
def add_up(first, entry, path, count, mu_t, depth):
    """Optical depths of a `Stretches`' rays at the lower edges of the slabs, into depth (S + 1, Q); mu_t (P + 1,)."""
    k = np.uint64(0)
    for i in range(count.shape[0]):
        tau = 0.0
        for s in range(count.shape[1]):
            for _ in range(count[i, s]):
                tau += mu_t[np.uint64(entry[k])] * path[k]
                k += np.uint64(1)
            depth[s + 1, first + i] = tau
