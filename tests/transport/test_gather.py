"""The brick table against the full volume, voxel for voxel."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.transport import lanes
from skinrender.transport.bricks import BRICK
from skinrender.transport.gather import find_planes, find_voxels, gather
from skinrender.transport.lanes import LANES, new_block
from skinrender.transport.medium import make_grid, make_rows
from skinrender.transport.move import locate
from tests.transport.block import row

PLANES, ENTRIES, SLABS, BANDS = 24, 700, 4, 3
UNEVEN, EVEN = [1e-4, 5e-3, 0.05, 1.0], [0.01, 0.025, 0.4]


def volume(nx, ny, seed=1, thickness=UNEVEN):
    """Palette volume of uniform, random and striped planes, the uneven ones partly thinner than a coarse depth cell."""
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.cumsum(rng.choice(thickness, PLANES))])
    index = np.empty((nx, ny, PLANES), np.uint16)
    index[:, :, :8] = np.arange(1, 9)
    index[:, :, 8:16] = rng.integers(0, ENTRIES, (nx, ny, 8))
    index[:, :, 16:] = 11 + (np.arange(nx)[:, None, None] // BRICK) % 3
    return index, edges


def numbered_rows():
    """Rows whose members tell slab, those of all bands in turn, and palette entry."""
    slab, entry = np.mgrid[: BANDS * SLABS, :ENTRIES]
    thresholds = np.stack([1000 * slab + entry, -1000 * slab - entry - 1], axis=-1).astype(np.int32)
    return make_rows(thresholds, np.linspace(-0.9, 0.9, ENTRIES), np.arange(ENTRIES) % 9)


def gathered(index, edges, ix, iy, z, real=np.float32, band=0):
    """Buffers after a gather at columns (n,) and depths (n,) in bands (n,), n at most LANES."""
    grid, rows = make_grid(index, edges, real), numbered_rows()
    f, w = new_block(real)
    n = len(z)
    row(f, lanes.Z, n)[:] = z
    column = np.floor_divide(ix, BRICK) * grid.bricks_y + np.floor_divide(iy, BRICK)
    row(w, lanes.BRICKS, n)[:] = column * PLANES
    row(w, lanes.IN_BRICK, n)[:] = np.mod(ix, BRICK) * BRICK + np.mod(iy, BRICK)
    row(w, lanes.BAND, n)[:] = band
    cells = grid.coarse_plane.size
    row(w, lanes.PLANE, n)[:] = np.clip(row(f, lanes.Z, n) * real(cells / edges[-1]), 0, cells - 1)
    plane_row = ((np.arange(PLANES) % SLABS + SLABS * np.arange(BANDS)[:, None]) * ENTRIES).ravel().astype(np.int32)
    find_planes(f, w, LANES, grid)
    find_voxels(w, LANES, grid)
    gather(f, w, LANES, grid, plane_row, rows)
    return f, w


@pytest.mark.parametrize("nx, ny", [(1, 1), (5, 3), (16, 32), (50, 17), (129, 40)])
@pytest.mark.parametrize("thickness", [UNEVEN, EVEN])
def test_every_voxel_is_found_in_every_band(nx, ny, thickness):
    index, edges = volume(nx, ny, thickness=thickness)
    assert (make_grid(index, edges, np.float32).edges_in_cell == 0) == (thickness is EVEN)
    rng = np.random.default_rng(2)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for _ in range(10):
        ix, iy, plane = (rng.integers(0, count, LANES) for count in (nx, ny, PLANES))
        ix[:4], iy[:4] = [0, nx - 1, 0, nx - 1], [0, 0, ny - 1, ny - 1]
        band = rng.integers(0, BANDS, LANES)
        f, w = gathered(index, edges, ix, iy, middle[plane], band=band)
        entry, slab = index[ix, iy, plane].astype(int), plane % SLABS + SLABS * band
        assert np.array_equal(row(w, lanes.SCATTER_BELOW), 1000 * slab + entry)
        assert np.array_equal(row(w, lanes.ABSORB_ABOVE), -1000 * slab - entry - 1)
        assert np.array_equal(row(f, lanes.G), np.linspace(-0.9, 0.9, ENTRIES)[entry].astype(np.float32))
        assert np.array_equal(row(w, lanes.TISSUE), entry % 9)


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("thickness", [UNEVEN, EVEN])
def test_plane_of_any_depth(real, thickness):
    """Also on edges and a rounding beside them, and a little beyond both ends; where cells end on the edges, to a rounding."""
    index, edges = volume(1, 1, thickness=thickness)
    index[0, 0] = np.arange(PLANES)
    rng = np.random.default_rng(3)
    z = [rng.uniform(0.0, edges[-1], 150), edges, np.nextafter(edges, 0), edges + 1e-5, [-1e-6]]
    z = np.concatenate(z).astype(real)
    _, w = gathered(index, edges, 0, 0, z, real)
    found, rounding = row(w, lanes.SCATTER_BELOW, z.size) % 1000, 0 if thickness is UNEVEN else 4 * np.spacing(z)
    low, high = (
        np.clip(np.searchsorted(edges.astype(real), at, side="right") - 1, 0, PLANES - 1) for at in (z - rounding, z + rounding)
    )
    assert np.all((found >= low) & (found <= high))
    assert np.count_nonzero(low < high) < 0.5 * z.size


def test_uniform_bricks_share_the_palette():
    index, edges = volume(64, 64)
    grid = make_grid(index, edges, np.float32)
    entries = int(index.max()) + 1
    assert grid.palette.size == entries + 8 * 16 * BRICK * BRICK
    assert np.array_equal(grid.palette[:entries], np.arange(entries))
    assert np.count_nonzero(grid.brick < 0) == 8 * 16


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("thickness", [UNEVEN, EVEN])
def test_lanes_that_ran_away_read_within_the_tables(real, thickness):
    """Lanes that are empty but in a group with others fly on with whatever they hold."""
    index, edges = volume(50, 17, thickness=thickness)
    grid = make_grid(index, edges, real)
    f, w = new_block(real)
    wild = np.array([np.nan, -np.inf, -1e30, 1e30, -1.0, 0.0, edges[-1], 2 * edges[-1]])
    for axis, values in zip((lanes.X, lanes.Y, lanes.Z), np.meshgrid(wild, wild, wild, indexing="ij")):
        row(f, axis)[:] = values.ravel()[:LANES] if axis != lanes.Z else np.resize(wild, LANES)
    cells = grid.coarse_plane.size
    with np.errstate(invalid="ignore"):
        locate(
            f, w, LANES, np.array([5.0, 1.7, cells / edges[-1]], real), np.array([49, 16, cells - 1], np.int32), grid.bricks_y,
            grid.planes
        )  # fmt: skip
        find_planes(f, w, LANES, grid)
    assert np.all((row(w, lanes.PLANE) >= 0) & (row(w, lanes.PLANE) < PLANES))
    find_voxels(w, LANES, grid)
    assert np.all((row(w, lanes.BRICKS) >= 0) & (row(w, lanes.BRICKS) < grid.brick.size))
    assert np.all((row(w, lanes.VOXEL) >= 0) & (row(w, lanes.VOXEL) < grid.palette.size))
