"""What view rays cross is kept once; every band's optical depths are sums over it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from skinrender.estimate.ray_paths import VISIBLE_DEPTH
from skinrender.estimate.transmittance import cross_voxels
from skinrender.transport.optical_depth import add_optical_depth

SIZE_MM = 2.0, 1.0
Z_EDGES_MM = np.array([0.0, 0.1, 0.15, 0.5, 1.2])
EDGES_MM = np.array([0.0, 0.12, 0.3, 1.1])
RAYS = 37


def volume_of(palette: np.ndarray, mu_t: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(
        tissue_index=palette, z_edges_mm=Z_EDGES_MM, size_mm=SIZE_MM, mu_a=0.25 * mu_t, mu_s=0.75 * mu_t,
        palette_layer=np.ones(len(mu_t), int),
    )  # fmt: skip


def slanted_rays(rng: np.random.Generator) -> SimpleNamespace:
    """Rays from the surface that miss now and then, with one direction in the first slab and another below."""
    direction = rng.normal(size=(2, RAYS, 3)) * (1.0, 1.0, 0.2) + (0.0, 0.0, 0.8)
    direction[..., 2] = np.abs(direction[..., 2]) + 0.05
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    region = np.array([0, 1, 1])
    entry = rng.uniform((0.0, 0.0, 0.0), (*SIZE_MM, 0.0), (RAYS, 3))
    steps = np.diff(EDGES_MM)[:, None] / direction[region, :, 2]
    edges = np.concatenate([np.zeros((1, RAYS)), np.cumsum(steps, axis=0)])
    return SimpleNamespace(
        hit=rng.random(RAYS) > 0.2, entry=entry, direction=direction, region=region, path_edges=edges
    )


def optical_depths(rays, volume, band: int, threads: int) -> np.ndarray:
    crossings = cross_voxels(rays, volume, threads)
    depth = np.zeros((len(EDGES_MM), RAYS), np.float32)
    with ThreadPoolExecutor(threads) as pool:
        return crossings.optical_depths(volume.mu_a[:, band] + volume.mu_s[:, band], pool, depth)


def followed(rays, volume) -> np.ndarray:
    """Optical depths (S + 1, Q, B), each slab of each ray through the voxels by itself."""
    mu_t = volume.mu_a + volume.mu_s
    depth = np.zeros((len(EDGES_MM), RAYS, mu_t.shape[1]))
    for q in np.flatnonzero(rays.hit):
        at, tau = rays.entry[q].copy(), np.zeros(mu_t.shape[1])
        for s, r in enumerate(rays.region):
            length = rays.path_edges[s + 1, q] - rays.path_edges[s, q]
            add_optical_depth(
                volume.tissue_index, Z_EDGES_MM, *SIZE_MM, mu_t, *at, *rays.direction[r, q], length, tau
            )
            at += length * rays.direction[r, q]
            depth[s + 1, q] = tau
    return depth


@pytest.mark.parametrize("threads", [1, 3])
def test_each_band_is_as_if_followed_for_it_alone(threads):
    rng = np.random.default_rng(1)
    volume = volume_of(rng.integers(0, 5, (40, 30, 4)).astype(np.uint16), rng.uniform(0.1, 5.0, (5, 3)))
    rays = slanted_rays(rng)
    expected = followed(rays, volume)
    for band in range(3):
        found = optical_depths(rays, volume, band, threads)
        np.testing.assert_allclose(found, expected[..., band], rtol=2e-6)
    assert (found[:, ~rays.hit] == 0.0).all() and rays.hit.any() and not rays.hit.all()


def test_where_no_band_sees_a_ray_is_not_followed():
    rng = np.random.default_rng(2)
    volume = volume_of(rng.integers(0, 2, (40, 30, 4)).astype(np.uint16), np.array([[900.0, 700.0], [800.0, 1100.0]]))
    rays = slanted_rays(rng)
    depth = optical_depths(rays, volume, 0, 2)[:, rays.hit]
    first, beyond = depth[1], np.diff(depth[1:], axis=0)
    assert (first > 3 * VISIBLE_DEPTH).all()
    np.testing.assert_allclose(beyond, 3 * VISIBLE_DEPTH, rtol=1e-6)


def test_a_stretch_goes_on_through_voxels_of_one_tissue():
    volume = volume_of(np.zeros((40, 30, 4), np.uint16), np.array([[2.0]]))
    rays = slanted_rays(np.random.default_rng(3))
    (part, *_), slabs = cross_voxels(rays, volume, 1).parts, len(EDGES_MM) - 1
    assert (part.count[rays.hit[: len(part.count)]] == 1).all()
    assert len(part.entry) == slabs * rays.hit[: len(part.count)].sum()


def test_a_level_ray_is_followed_as_far_as_it_sees():
    """The rest of the slab is like what was seen: depth between its edges is interpolated."""
    rng = np.random.default_rng(4)
    volume = volume_of(rng.integers(0, 2, (40, 30, 4)).astype(np.uint16), np.array([[90.0], [80.0]]))
    rays = slanted_rays(rng)
    rays.path_edges = rays.path_edges * 1e5
    parts = cross_voxels(rays, volume, 2).parts
    assert sum(len(part.path) for part in parts) < 1000 * rays.hit.sum()
    recorded = sum(part.path[part.entry < 2].sum(dtype=float) for part in parts)
    assert recorded == pytest.approx(rays.path_edges[1, rays.hit].sum(), rel=1e-5)
    steepness = optical_depths(rays, volume, 0, 2)[1, rays.hit] / rays.path_edges[1, rays.hit]
    assert np.all((steepness > 80.0) & (steepness < 90.0))
