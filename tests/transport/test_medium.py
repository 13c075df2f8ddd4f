"""From described tissue to flat arrays: majorants, slabs, number type."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from skinrender.transport import lanes
from skinrender.transport.borders import majorant_depth
from skinrender.transport.lanes import LANES, SLABS, new_block
from skinrender.transport.medium import (
    block_type,
    choose_slabs,
    make_grid,
    make_majorant,
)  # fmt: skip
from skinrender.transport.move import fly
from tests.transport.block import row, set_slabs


def planes(seed, count=9):
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.5, count))])
    return edges, rng.choice([0.0, 2.0, 20.0, 60.0, 200.0], count)


def collisions(mu_t, edges, first):
    """What the choice of slabs minimizes: collisions with the majorant, weighted by the light."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    weight = np.diff(edges) * (np.exp(-middle / 0.5) + 0.02)
    ends = np.append(first[1:], mu_t.size)
    return sum(mu_t[a:b].max() * weight[a:b].sum() for a, b in zip(first, ends))


@pytest.mark.parametrize("seed", range(4))
def test_no_other_choice_of_slabs_has_fewer_null_collisions(seed):
    edges, mu_t = planes(seed)
    first = choose_slabs(mu_t, edges)
    assert first[0] == 0 and np.all(np.diff(first) > 0) and first.size <= SLABS
    best = min(
        collisions(mu_t, edges, np.array([0, *cuts]))
        for n in range(SLABS)
        for cuts in itertools.combinations(range(1, mu_t.size), n)
    )
    assert collisions(mu_t, edges, first) == pytest.approx(best, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_majorant_bounds_each_plane_and_depth_is_its_integral(seed):
    edges, mu_t = planes(seed)
    majorant, plane_slab = make_majorant(mu_t, edges)
    assert np.all(majorant[plane_slab, 2] >= mu_t) and np.all(majorant[:, 2] > 0.0)
    depth = np.concatenate([[0.0], np.cumsum(majorant[plane_slab, 2] * np.diff(edges))])
    assert [majorant_depth(majorant[None], 0, z) for z in edges] == pytest.approx(depth)


def test_equal_planes_are_one_slab_whatever_their_number():
    for count in (1, 2, 50):
        majorant, _ = make_majorant(np.full(count, 7.0), np.linspace(0.0, 1.0, count + 1))
        assert majorant.tolist() == [[0.0, 0.0, 7.0]]


def test_slabs_of_very_many_planes_are_bounds_still():
    """As many as an epidermis of 0.1 um under a wave has; all pairs of them would take minutes."""
    rng = np.random.default_rng(5)
    mu_t, edges = rng.uniform(1.0, 50.0, 8000), np.linspace(0.0, 0.4, 8001)
    majorant, plane_slab = make_majorant(mu_t, edges)
    assert np.all(majorant[plane_slab, 2] >= mu_t)


@pytest.mark.parametrize("edges", [np.linspace(0.0, 70.0, 70_001), np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1e-9, 1e5])])
def test_coarse_planes_of_odd_stacks(edges):
    """Very many planes, an empty one, one far thinner than a cell."""
    index = np.zeros((1, 1, edges.size - 1), np.uint16)
    grid = make_grid(index, edges, np.float64)
    cells = grid.coarse_plane.size
    middle = (np.arange(cells) + 0.5) * edges[-1] / cells
    plane = np.searchsorted(edges, middle, side="right") - 1
    assert np.all((grid.coarse_plane <= plane) & (plane <= grid.coarse_plane + grid.edges_in_cell))


def depth_error_mm(mu_t, edges):
    """Largest error of the depth that a flight in the chosen number type ends at."""
    majorant, _ = make_majorant(mu_t, edges)
    real = block_type(majorant, edges)
    f, w = new_block(real)
    w[:] = np.random.default_rng(1).integers(-(2**31), 2**31, w.size)
    z = np.linspace(0.0, edges[-1], LANES)
    row(f, lanes.M)[:] = [majorant_depth(majorant[None], 0, value) for value in z]
    row(f, lanes.UX)[:], row(f, lanes.UZ)[:] = 1.0, 0.0
    set_slabs(f, majorant)
    fly(f, w, LANES)
    return np.abs(row(f, lanes.Z) - z).max(), np.diff(edges).min()


STIFF = {
    "skin": ([0.01, 0.07, 0.1, 1.5, 1.2], [60.0, 90.0, 25.0, 20.0, 15.0]),
    "ink between": ([3.0, 1e-3, 3.0], [10.0, 5000.0, 10.0]),
    "clear over dense": ([10.0, 1.0, 0.05], [0.0, 1000.0, 20.0]),
    "dense over clear": ([1.0, 10.0, 0.1], [1000.0, 0.0, 10.0]),
    "deep": ([1.0, 1.0], [1e4, 3.0]),
    "thin": ([1e-4], [1.0]),
}


@pytest.mark.parametrize("name", STIFF)
def test_number_type_resolves_the_thinnest_plane(name):
    thickness, mu_t = STIFF[name]
    error, thinnest = depth_error_mm(np.array(mu_t), np.concatenate([[0.0], np.cumsum(thickness)]))
    assert error < 0.01 * thinnest


def test_ordinary_skin_flies_in_single_precision():
    thickness, mu_t = STIFF["skin"]
    edges = np.concatenate([[0.0], np.cumsum(thickness)])
    assert block_type(make_majorant(np.array(mu_t), edges)[0], edges) is np.float32
