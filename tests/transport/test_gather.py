"""The brick table against the full volume, voxel for voxel."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.transport.gather import BRICK, NEVER_ABSORB, NEVER_SCATTER, gather, palette_entry, plane_of
from skinrender.transport.lanes import (
    ABSORB_ABOVE, BORDER, G, IX, IY, IZ, LANES, SCATTER_BELOW, TISSUE, Z, new_block,
)  # fmt: skip
from skinrender.transport.medium import make_grid

COARSE_CELLS = 4096


def volume(nx, ny, seed=1):
    """Palette volume of uniform, striped and random planes, some thinner than a coarse depth cell."""
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.cumsum(rng.choice([1e-4, 5e-3, 0.05, 1.0], 24))])
    index = np.empty((nx, ny, 24), np.uint16)
    index[:, :, :8] = np.arange(1, 9)
    index[:, :, 8:16] = rng.integers(0, 700, (nx, ny, 8))
    index[:, :, 16:] = 11 + (np.arange(nx)[:, None, None] // BRICK) % 3
    return index, edges


@pytest.mark.parametrize("nx, ny", [(1, 1), (5, 3), (16, 32), (50, 17), (129, 40)])
def test_every_voxel_is_found(nx, ny):
    index, edges = volume(nx, ny)
    grid = make_grid(index, edges, np.float32)[0]
    rng = np.random.default_rng(2)
    for ix, iy, plane in zip(rng.integers(0, nx, 500), rng.integers(0, ny, 500), rng.integers(0, 24, 500)):
        assert palette_entry(grid, np.int32(ix), np.int32(iy), plane) == index[ix, iy, plane]
    for ix, iy in ((0, 0), (nx - 1, 0), (0, ny - 1), (nx - 1, ny - 1)):
        assert [palette_entry(grid, np.int32(ix), np.int32(iy), k) for k in range(24)] == index[ix, iy].tolist()


def test_uniform_bricks_are_stored_once():
    index, edges = volume(64, 64)
    grid = make_grid(index, edges, np.float32)[0]
    assert grid.palette.size == 16 * 16 + 8 * 16 * BRICK * BRICK
    assert np.count_nonzero(grid.brick & 1) == 8 * 16


def test_what_each_plane_holds():
    index, edges = volume(20, 20)
    holds = make_grid(index, edges, np.float32)[1]
    assert all(set(np.flatnonzero(holds[k])) == set(np.unique(index[:, :, k])) for k in range(24))


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_plane_of_any_depth(real):
    index, edges = volume(1, 1)
    grid = make_grid(index, edges, real)[0]
    rng = np.random.default_rng(3)
    z = np.concatenate([rng.uniform(0.0, edges[-1], 2000), edges, np.nextafter(edges, 0), edges + 1e-5]).astype(real)
    z = z[(z >= 0.0) & (z <= grid.plane_edge[-1])]
    coarse = np.minimum(z * real(COARSE_CELLS / edges[-1]), COARSE_CELLS - 1).astype(np.int32)
    found = [plane_of(grid, c, value) for c, value in zip(coarse, z)]
    assert np.array_equal(found, np.clip(np.searchsorted(grid.plane_edge, z, side="right") - 1, 0, 23))


def test_a_lane_collides_in_its_voxel_and_never_on_a_border():
    index, edges = volume(40, 40)
    grid = make_grid(index, edges, np.float32)[0]
    rng = np.random.default_rng(4)
    plane_slab = np.repeat(np.arange(4), 6).astype(np.int32)
    thresholds = rng.integers(-(2**31), 2**31, (4, 700, 2)).astype(np.int32)
    anisotropy, layer = rng.uniform(-1, 1, 700).astype(np.float32), rng.integers(0, 9, 700).astype(np.int32)
    f, w = new_block(np.float32)
    lanes = np.arange(LANES)
    plane = rng.integers(0, 24, LANES)
    f[Z + lanes] = (0.5 * (edges[1:] + edges[:-1]))[plane]
    w[IX + lanes], w[IY + lanes] = rng.integers(0, 40, (2, LANES))
    w[IZ + lanes] = f[Z + lanes] * (COARSE_CELLS / edges[-1])
    w[BORDER + lanes] = lanes % 5 == 0
    f[G + lanes], w[TISSUE + lanes] = -2.0, -2
    gather(f, w, LANES, grid, plane_slab, thresholds, anisotropy, layer)
    border = w[BORDER + lanes] == 1
    entry = index[w[IX + lanes], w[IY + lanes], plane]
    slab = plane_slab[plane]
    assert np.array_equal(w[SCATTER_BELOW + lanes], np.where(border, NEVER_SCATTER, thresholds[slab, entry, 0]))
    assert np.array_equal(w[ABSORB_ABOVE + lanes], np.where(border, NEVER_ABSORB, thresholds[slab, entry, 1]))
    assert np.array_equal(f[G + lanes], np.where(border, np.float32(-2), anisotropy[entry]))
    assert np.array_equal(w[TISSUE + lanes], np.where(border, -2, layer[entry]))
