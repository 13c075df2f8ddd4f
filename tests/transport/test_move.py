"""Free flight, periodic wrap and cell look-up against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.transport import lanes, tally
from skinrender.transport.blockmath import log_unit
from skinrender.transport.bricks import BRICK
from skinrender.transport.gather import find_planes, find_voxels, gather
from skinrender.transport.lanes import LANES, SLABS, new_block
from skinrender.transport.medium import collision_thresholds, make_grid, make_majorant, make_rows
from skinrender.transport.move import fly, locate, mark_sides, wrap
from skinrender.transport.rng import uniform
from skinrender.transport.turn import collide
from tests.stats import assert_fits
from tests.transport.block import row, set_slabs

STACKS = {
    "one slab": ([2.0], [10.0]),
    "two slabs": ([0.5, 1.0], [3.0, 40.0]),
    "five slabs": ([0.02, 0.05, 0.1, 1.0, 2.0], [90.0, 20.0, 150.0, 5.0, 30.0]),
    "clear between": ([0.3, 1.0, 0.5], [20.0, 0.0, 8.0]),
}


def stack(name):
    """Edges (mm), extinction and majorant of a stack with one voxel plane a slab."""
    thickness, mu_t = (np.array(values) for values in STACKS[name])
    edges = np.concatenate([[0.0], np.cumsum(thickness)])
    return edges, mu_t, *make_majorant(mu_t, edges)


def depth_at(majorant, edges, z):
    """Majorant optical depth by interpolation, continued beyond both ends."""
    top, depth, mu_t = majorant.T
    nodes, at_nodes = np.append(top, edges[-1]), np.append(depth, depth[-1] + (edges[-1] - top[-1]) * mu_t[-1])
    return np.interp(z, nodes, at_nodes) + np.minimum(z, 0.0) * mu_t[0] + np.maximum(z - edges[-1], 0.0) * mu_t[-1]


def free_optical_depths(w):
    """Optical depth that `fly` will draw in each lane."""
    first = (row(w, lanes.WORDS).astype(np.int64) + row(w, lanes.WORDS + 3 * LANES)).astype(np.int32)
    return np.array([-float(log_unit(uniform(word))) for word in first])


def spread(real, seed, edges, majorant):
    """A block of photons spread over a stack, in all directions."""
    f, w = new_block(real)
    rng = np.random.default_rng(seed)
    w[: 4 * LANES] = rng.integers(-(2**31), 2**31, 4 * LANES)
    u = rng.normal(size=(3, LANES))
    row(f, lanes.UX)[:], row(f, lanes.UY)[:], row(f, lanes.UZ)[:] = u / np.linalg.norm(u, axis=0)
    row(f, lanes.X)[:], row(f, lanes.Y)[:] = rng.uniform(0.0, 5.0, (2, LANES))
    row(f, lanes.Z)[:] = rng.uniform(edges[0], edges[-1], LANES)
    row(f, lanes.M)[:] = depth_at(majorant, edges, row(f, lanes.Z))
    row(f, lanes.Z_SAFE_TOP)[:], row(f, lanes.Z_SAFE_BOTTOM)[:] = edges[0], edges[-1]
    set_slabs(f, majorant)
    return f, w


@pytest.mark.parametrize("name", STACKS)
@pytest.mark.parametrize("real, tolerance", [(np.float32, 3e-4), (np.float64, 3e-6)])
def test_flight_is_the_optical_length_through_all_slabs(name, real, tolerance):
    edges, _, majorant, _ = stack(name)
    f, w = spread(real, 5, edges, majorant)
    before, tau = f.astype(float), free_optical_depths(w)
    fly(f, w, LANES)
    m0, uz, z0 = (row(before, k) for k in (lanes.M, lanes.UZ, lanes.Z))
    m1, z1, path = (row(f, k).astype(float) for k in (lanes.M, lanes.Z, lanes.PATH))
    size = np.abs(m0) + tau
    assert np.all(np.abs(m1 - m0 - uz * tau) <= tolerance * size)
    assert np.all(np.abs(depth_at(majorant, edges, z1) - m1) <= tolerance * size)
    assert np.array_equal(row(f, lanes.Z_START), row(before, lanes.Z).astype(real))
    assert np.all(np.abs(z0 + uz * path - z1) <= tolerance * (path + edges[-1]))
    for axis, u in ((lanes.X, lanes.UX), (lanes.Y, lanes.UY)):
        assert np.allclose(row(f, axis), row(before, axis) + row(before, u) * path, rtol=1e-5, atol=tolerance)
    left = (z1 < edges[0]) | (z1 > edges[-1])
    assert left.any() and not left.all()
    assert np.array_equal(row(w, lanes.BORDER) == 1, left)


def test_lanes_beyond_n_stay():
    edges, _, majorant, _ = stack("two slabs")
    f, w = spread(np.float32, 6, edges, majorant)
    before = f.copy(), w.copy()
    fly(f, w, 100)
    for buffer, old in zip((f, w), before):
        assert np.array_equal(buffer.reshape(-1, LANES)[:, 100:], old.reshape(-1, LANES)[:, 100:])


@pytest.mark.parametrize("uz", [0.0, 1e-6, -1e-4, 9e-4, -2e-3])
def test_level_flight_keeps_its_free_path(uz):
    edges, mu_t, majorant, _ = stack("two slabs")
    f, w = spread(np.float32, 7, edges, majorant)
    row(f, lanes.UX)[:], row(f, lanes.UY)[:], row(f, lanes.UZ)[:] = np.sqrt(1.0 - uz * uz), 0.0, uz
    row(f, lanes.Z)[:] = 0.25
    row(f, lanes.M)[:] = 0.25 * mu_t[0]
    tau = free_optical_depths(w)
    fly(f, w, LANES)
    assert np.allclose(row(f, lanes.PATH), tau / mu_t[0], rtol=3e-4, atol=1e-7)


@pytest.mark.parametrize("uz", [0.7, -0.7, 0.02])
@pytest.mark.parametrize("beyond_mm", [1e-5, 1e-3])
def test_path_across_the_edge_of_a_clear_layer(uz, beyond_mm):
    """A short flight from 100 mm free path to 0.05 or 0.125 mm, or back: sideways it goes as far as it sinks."""
    edges, _, majorant, _ = stack("clear between")
    f, w = spread(np.float32, 12, edges, majorant)
    row(f, lanes.UX)[:], row(f, lanes.UY)[:], row(f, lanes.UZ)[:] = np.sqrt(1.0 - uz * uz), 0.0, uz
    for start in (0.3 - beyond_mm, 0.3 + beyond_mm, 1.3 - beyond_mm, 1.3 + beyond_mm):
        row(f, lanes.X)[:], row(f, lanes.Z)[:] = 0.0, start
        row(f, lanes.M)[:] = depth_at(majorant, edges, np.float32(start))
        fly(f, w, LANES)
        sunk = row(f, lanes.Z).astype(float) - start
        assert np.allclose(row(f, lanes.X) * uz, sunk * np.sqrt(1.0 - uz * uz), rtol=0.02, atol=1e-5)


def test_free_paths_are_exponential():
    edges, mu_t, majorant, _ = stack("one slab")
    f, w = spread(np.float32, 8, edges, majorant)
    paths = []
    for _ in range(200):
        row(f, lanes.M)[:], row(f, lanes.Z)[:] = 10.0, 1.0
        fly(f, w, LANES)
        paths.append(row(f, lanes.PATH).copy())
    edges = np.append(np.linspace(0.0, 0.9, 52), np.inf)
    assert_fits(np.histogram(np.concatenate(paths), edges)[0], -np.diff(np.exp(-mu_t[0] * edges)))


@pytest.mark.parametrize("uz", [0.8, -0.6])
def test_first_collision_follows_the_transmittance_of_what_is_really_there(uz):
    """Voxels of five planes and of two columns, thinner than their majorant: null collisions make up for it."""
    thickness = np.array([0.02, 0.05, 0.1, 0.4, 1.0])
    edges = np.concatenate([[0.0], np.cumsum(thickness)])
    mu_t = np.array([[0.0, 0.0], [50.0, 8.0], [3.0, 12.0], [0.0, 20.0], [6.0, 0.5], [2.0, 2.0]])[1:]
    palette_index = (1 + np.arange(5)[None, :] + np.array([0, 5])[:, None]).astype(np.uint16)[:, None, :]
    mu_a = np.concatenate([[0.0], mu_t[:, 0], mu_t[:, 1]])
    majorant, plane_slab = make_majorant(mu_t.max(axis=1), edges)
    assert 1 < len(majorant) <= SLABS
    grid = make_grid(palette_index, edges, np.float32)
    zeros = np.zeros(mu_a.size)
    rows = make_rows(collision_thresholds(mu_a, zeros, majorant[:, 2]), zeros, zeros)
    plane_row = plane_slab * np.int32(mu_a.size)
    depth_cells = grid.coarse_plane.size
    cells = np.array([1.0, 0.5, depth_cells / edges[-1]], np.float32)

    f, w = spread(np.float32, 9, edges, majorant)
    start = 0.0 if uz > 0.0 else edges[-1]
    collided = [[], []]
    f_start = f.copy()
    for _ in range(60):
        f[:] = f_start
        row(f, lanes.X)[:] = np.where(np.arange(LANES) < LANES // 2, 0.5, 1.5)
        row(f, lanes.Y)[:], row(f, lanes.UX)[:], row(f, lanes.UY)[:], row(f, lanes.UZ)[:] = 1.0, 0.0, 0.0, uz
        row(f, lanes.Z)[:], row(f, lanes.M)[:] = start, depth_at(majorant, edges, start)
        flying, where = np.ones(LANES, bool), np.zeros(LANES)
        while flying.any():
            fly(f, w, LANES)
            locate(f, w, LANES, cells, np.array([1, 0, depth_cells - 1], np.int32), 1, grid.planes)
            find_planes(f, w, LANES, grid)
            find_voxels(w, LANES, grid)
            gather(f, w, LANES, grid, plane_row, rows)
            collide(f, w, LANES, tally.PER_LAYER + 1, tally.columns(1))
            left = flying & (row(w, lanes.BORDER) == 1)
            ended = left | (flying & (row(w, lanes.ENDED) == 1))
            where[ended] = np.where(left, np.inf, row(f, lanes.Z))[ended]
            flying &= ~ended
        collided[0].append(where[: LANES // 2])
        collided[1].append(where[LANES // 2 :])

    bins = np.unique(np.concatenate([edges, np.linspace(0.0, edges[-1], 40)]))
    middle = 0.5 * (bins[1:] + bins[:-1])
    plane = np.searchsorted(edges, middle) - 1
    for column in (0, 1):
        tau = np.concatenate([[0.0], np.cumsum(mu_t[plane, column] * np.diff(bins))]) / abs(uz)
        transmittance = np.exp(-tau) if uz > 0.0 else np.exp(tau - tau[-1])
        expected = np.append(np.abs(np.diff(transmittance)), np.exp(-tau[-1]))
        where = np.concatenate(collided[column])
        counts = np.append(np.histogram(where[np.isfinite(where)], bins)[0], np.isinf(where).sum())
        assert counts.sum() == where.size
        assert_fits(counts, expected, comparisons=4)


@pytest.mark.parametrize("real, tolerance", [(np.float32, 2e-5), (np.float64, 1e-12)])
def test_wrap_is_the_periodic_image_inside_the_patch(real, tolerance):
    f, _ = new_block(real)
    rng = np.random.default_rng(10)
    for axis, size in ((lanes.X, 3.0), (lanes.Y, 0.7)):
        row(f, axis)[:] = rng.uniform(-40.0, 40.0, LANES)
        row(f, axis)[:6] = [0.0, size, -size, 5 * size, -1e-9, np.nextafter(real(size), real(0))]
    before = f.astype(float)
    wrap(f, LANES, real(3.0), real(0.7))
    for axis, size in ((lanes.X, 3.0), (lanes.Y, 0.7)):
        after, shift = row(f, axis).astype(float), row(f, axis) - row(before, axis)
        assert np.all((after >= 0.0) & (after <= float(real(size))))
        assert np.abs(shift / size - np.rint(shift / size)).max() < tolerance
        inside = (row(before, axis) > 0.0) & (row(before, axis) < 0.99 * size)
        assert inside.any() and np.array_equal(after[inside], row(before, axis)[inside])


def test_a_lane_outside_open_sides_has_met_a_border():
    f, w = new_block(np.float32)
    row(f, lanes.X)[:6] = [0.0, 2.0, -1e-6, 2.0001, 1.0, 1.0]
    row(f, lanes.Y)[:6] = [0.0, 1.0, 0.5, 0.5, -0.1, 1.1]
    w[lanes.BORDER + 1] = 1
    mark_sides(f, w, 6, np.float32(2.0), np.float32(1.0))
    assert row(w, lanes.BORDER, 6).tolist() == [0, 1, 1, 1, 1, 1]


def test_locate_finds_the_cell_and_stays_in_the_volume():
    f, w = new_block(np.float32)
    rng = np.random.default_rng(11)
    axes = [row(f, axis) for axis in (lanes.X, lanes.Y, lanes.Z)]
    for axis, extent in zip(axes, (2.0, 1.0, 4.0)):
        axis[:] = rng.uniform(0.0, extent, LANES)
    row(f, lanes.X)[:3], row(f, lanes.Y)[:3], row(f, lanes.Z)[:3] = [0.0, 2.0, 1.0], [0.0, 1.0, 0.5], [-0.5, 4.5, 4.0]
    bricks_y = -(-30 // BRICK)
    locate(f, w, LANES, np.array([50.0, 30.0, 1024.0], np.float32), np.array([99, 29, 4095], np.int32), bricks_y, 7)
    limits = ((50.0, 99), (30.0, 29), (1024.0, 4095))
    ix, iy, iz = (np.clip(np.floor(a * np.float32(per_mm)), 0, last) for a, (per_mm, last) in zip(axes, limits))
    assert np.array_equal(row(w, lanes.BRICKS), (ix // BRICK * bricks_y + iy // BRICK) * 7)
    assert np.array_equal(row(w, lanes.IN_BRICK), ix % BRICK * BRICK + iy % BRICK)
    assert np.array_equal(row(w, lanes.PLANE), iz)
