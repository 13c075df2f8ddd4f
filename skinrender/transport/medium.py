"""From described tissue to the flat arrays that the walk reads: the crossing between the two worlds.

Nothing here is a kernel; it runs once per scene and type of the block.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skinrender.transport.borders import Borders
from skinrender.transport.bricks import BRICK
from skinrender.transport.gather import ROW, Grid
from skinrender.transport.height_field import bulge_bound, cell_bounds
from skinrender.transport.lanes import SLABS
from skinrender.transport.relief import NEAR, TILE, Relief

_COARSE_CELLS = 4096
"""Depth cells, at most; as many where they do not end on the edges of the planes."""
_MOST_PARTS = 10
"""Cells that the thinnest plane may be cut into, so that they end on the edges of all."""
_MOST_RUNS = 512
"""Planes of different extinction among which slabs may begin; with more, every second or third of them."""
_WORD = 2.0**32


class Medium(NamedTuple):
    """All that a walk reads of the tissue in its B bands, besides the relief (see `walk`).

    majorant (B, SLABS, 3), see `make_majorant`; slabs (B, 2 SLABS - 1), see `flight_constants`; plane_row (B planes,):
    first row of each band and plane; rows of all bands, see `make_rows`.
    """

    borders: Borders
    majorant: np.ndarray
    slabs: np.ndarray
    grid: Grid
    cells_per_mm: np.ndarray
    last_cell: np.ndarray
    plane_row: np.ndarray
    rows: np.ndarray
    layers: int
    period: np.ndarray
    z_top: float


def make_grid(palette_index: np.ndarray, z_edges_mm: np.ndarray, real: type) -> Grid:
    """The voxels as bricks.

    palette_index (nx, ny, nz) uint16, z_edges_mm (nz + 1,) from the top of the volume; `real`: type of the block.
    """
    nx, ny, nz = palette_index.shape
    bricks_x, bricks_y = -(-nx // BRICK), -(-ny // BRICK)
    padding = (0, bricks_x * BRICK - nx), (0, bricks_y * BRICK - ny), (0, 0)
    cells = np.pad(palette_index, padding, mode="edge").reshape(bricks_x, BRICK, bricks_y, BRICK, nz).transpose(0, 2, 4, 1, 3).reshape(-1, BRICK * BRICK)
    uniform = (cells == cells[:, :1]).all(axis=1)
    entries = np.arange(int(cells.max()) + 1, dtype=np.uint16)
    varied = entries.size + BRICK * BRICK * (np.cumsum(~uniform) - 1)
    brick = np.where(uniform, cells[:, 0], varied - 2**31).astype(np.int32)
    palette = np.concatenate([entries, cells[~uniform].ravel()])

    coarse, edges_in_cell = _coarse_planes(z_edges_mm)
    next_edge = np.append(z_edges_mm[1:-1], np.inf).astype(real)
    return Grid(coarse, edges_in_cell, next_edge, brick, palette, bricks_y, nz)


def _coarse_planes(z_edges_mm: np.ndarray) -> tuple[np.ndarray, int]:
    """First plane of each coarse depth cell, and how many edges of planes may follow up to a depth in the cell."""
    planes = z_edges_mm.size - 1
    cells = _cells_between_edges(z_edges_mm)
    if cells is not None:
        middle = (np.arange(cells) + 0.5) * (z_edges_mm[-1] / cells)
        return (np.searchsorted(z_edges_mm, middle) - 1).astype(np.int32), 0
    top = np.arange(_COARSE_CELLS) * (z_edges_mm[-1] / _COARSE_CELLS)
    # one cell above and one below: a rounded product may fall into the next cell
    first = np.searchsorted(z_edges_mm, np.concatenate([[0.0], top[:-1]]), side="right") - 1
    last = np.searchsorted(z_edges_mm, np.append(top[2:], [np.inf] * 2), side="right") - 1
    return np.clip(first, 0, planes - 1).astype(np.int32), int((last - first).max())


def _cells_between_edges(z_edges_mm: np.ndarray) -> int | None:
    """Number of equal cells that end on all edges of the planes; None where that takes more than _COARSE_CELLS."""
    thinnest = np.diff(z_edges_mm).min()
    if thinnest * _COARSE_CELLS < z_edges_mm[-1]:
        return None
    for parts in range(1, _MOST_PARTS + 1):
        at = z_edges_mm * (parts / thinnest)
        cells = round(at[-1])
        if cells <= _COARSE_CELLS and np.abs(at - np.rint(at)).max() < 1e-6:
            return cells
    return None


def choose_slabs(plane_mu_t: np.ndarray, z_edges_mm: np.ndarray, fluence_depth_mm: float = 0.5) -> np.ndarray:
    """First plane of each majorant slab, at most SLABS of them, fewest null collisions (dynamic programming).

    plane_mu_t (planes,): largest extinction of each plane. The weight of a plane is its share of the light, taken to
    fall over `fluence_depth_mm` on a floor that keeps deep planes from being ignored. Equal neighbors are one plane, as no
    slab is the better for beginning between them.
    """
    middle = 0.5 * (z_edges_mm[1:] + z_edges_mm[:-1])
    weight = np.diff(z_edges_mm) * (np.exp(-middle / fluence_depth_mm) + 0.02)
    first = np.flatnonzero(np.append(True, plane_mu_t[1:] != plane_mu_t[:-1]))
    first = first[:: -(-first.size // _MOST_RUNS)]
    return first[_cut(np.maximum.reduceat(plane_mu_t, first), np.add.reduceat(weight, first))]


def _cut(plane_mu_t: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """First plane of each of at most SLABS slabs whose sum of largest mu_t times weight is least, in quadratic time."""
    planes = plane_mu_t.size
    total = np.concatenate([[0.0], np.cumsum(weight)])
    cost = np.full((SLABS + 1, planes + 1), np.inf)
    start = np.zeros((SLABS + 1, planes + 1), dtype=int)
    cost[0, 0] = 0.0
    for end in range(1, planes + 1):
        largest = np.maximum.accumulate(plane_mu_t[:end][::-1])[::-1]
        slab_cost = largest * (total[end] - total[:end])
        for k in range(1, SLABS + 1):
            through = cost[k - 1, :end] + slab_cost
            best = int(np.argmin(through))
            cost[k, end], start[k, end] = through[best], best
    # the fewest slabs that are as good as the best: equal planes are one slab, however many they are
    count = int(np.argmax(cost[1:, planes] <= cost[1:, planes].min() * (1.0 + 1e-12))) + 1
    first = []
    end = planes
    for k in range(count, 0, -1):
        end = start[k, end]
        first.append(end)
    return np.array(first[::-1])


def make_majorant(plane_mu_t: np.ndarray, z_edges_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Majorant slabs (slabs, 3): upper edge (mm), its optical depth, majorant (1/mm); and the slab of each plane.

    A clear slab gets a small majorant, so that depth stays a function of optical depth; its collisions are null.
    """
    first = choose_slabs(plane_mu_t, z_edges_mm)
    thickness = np.diff(np.append(z_edges_mm[first], z_edges_mm[-1]))
    mu_t = np.maximum(np.maximum.reduceat(plane_mu_t, first), 1e-2 / thickness)
    depth = np.concatenate([[0.0], np.cumsum(mu_t * thickness)])
    plane_slab = np.searchsorted(first, np.arange(plane_mu_t.size), side="right") - 1
    return np.column_stack([z_edges_mm[first], depth[:-1], mu_t]), plane_slab.astype(np.int32)


def flight_constants(majorant: np.ndarray, real: type) -> np.ndarray:
    """Of a band, what its lanes hold for `move.fly`: lower optical depths, first reciprocal majorant and its changes,
    padded to SLABS."""
    free_path = 1.0 / majorant[:, 2]
    slabs = len(majorant)
    lower = np.full(SLABS - 1, float(np.finfo(np.float32).max))
    change = np.zeros(SLABS - 1)
    lower[: slabs - 1] = majorant[1:, 1]
    change[: slabs - 1] = np.diff(free_path)
    return np.concatenate([lower, free_path[:1], change]).astype(real)


def collision_thresholds(mu_a: np.ndarray, mu_s: np.ndarray, majorant_mu_t: np.ndarray) -> np.ndarray:
    """Signed 32-bit thresholds (slabs, P, 2): a word below the first scatters, one above the second is absorbed.

    Rounding is to 2^-32 of the majorant; a coefficient of exactly 0 never happens, the gap between is null.
    """
    scatter = np.rint(np.minimum(mu_s / majorant_mu_t[:, None], 1.0) * _WORD) - 2.0**31
    absorb = 2.0**31 - 1 - np.rint(np.minimum(mu_a / majorant_mu_t[:, None], 1.0) * _WORD)
    both = np.stack([scatter, absorb], axis=-1)
    return np.clip(both, -(2.0**31), 2.0**31 - 1).astype(np.int32)


def block_type(majorant: np.ndarray, z_edges_mm: np.ndarray) -> type:
    """float32, or float64 for a stack that is stiff."""
    return np.float32 if stiffness(majorant, z_edges_mm) is None else np.float64


def stiffness(majorant: np.ndarray, z_edges_mm: np.ndarray) -> str | None:
    """What float32 can't resolve of a stack: the thinnest plane or slab (to a thousandth) at its depth; None: it can.

    `move.fly` makes depth from optical depth times free path, summed over the slabs: under, over and in a clear layer
    small numbers are left of large ones. What is rounded away has to stay below a hundredth of the thinnest plane and
    of the shortest free path.
    """
    z, tau, mu_t = majorant[-1]
    depth = np.append(majorant[:, 1], tau + mu_t * (z_edges_mm[-1] - z))
    free_path = 1.0 / majorant[:, 2]
    changes = np.abs(np.diff(free_path)) * (depth[-1] - depth[1:-1])
    largest = max((free_path * depth[1:]).max(), changes.max(initial=0.0))
    rounded_away = 2.0**-24 * largest > 0.01 * min(np.diff(z_edges_mm).min(), free_path.min())
    resolved = 2.0**-24 * 1e3
    thin_plane = (np.diff(z_edges_mm) < resolved * z_edges_mm[1:]).any()
    thin_slab = (np.diff(depth) < resolved * depth[1:]).any()
    if thin_plane or thin_slab:
        return "a plane is too thin for its depth"
    if rounded_away:
        return "free paths are too short for the depth"
    return "the optical depth is above 2000" if depth[-1] > 2000.0 else None


def make_relief(heights: list[np.ndarray], size_mm: tuple[float, float]) -> Relief | None:
    """Height fields (hx, hy), mm from the top of the volume, with what is known around their cells; None without
    any."""
    if not heights:
        return None
    bounds = np.stack([cell_bounds(field) for field in heights])
    around = np.stack([_around(field, cells[..., 1], size_mm) for field, cells in zip(heights, bounds)])
    cells = np.array(heights[0].shape)
    return Relief(
        np.stack(heights), bounds, around.astype(np.float32), (cells / (TILE * np.array(size_mm))).astype(np.float32),
        (-(-cells // TILE) - 1).astype(np.int32),
    )  # fmt: skip


def _around(field: np.ndarray, highest: np.ndarray, size_mm: tuple[float, float]) -> np.ndarray:
    """`Relief.around` of one height field."""
    known = (highest, bulge_bound(field, *size_mm))
    near = np.stack([_largest_of_tiles(_largest_within(each, NEAR)) for each in known], axis=-1)
    return np.concatenate([near.reshape(-1, 2), [[each.max() for each in known]]])


def _largest_within(field: np.ndarray, cells: int) -> np.ndarray:
    """Largest value within so many cells of each cell on both axes, periodically; (hx, hy)."""
    for axis in (0, 1):
        field = np.maximum.reduce([np.roll(field, shift, axis) for shift in range(-cells, cells + 1)])
    return field


def _largest_of_tiles(field: np.ndarray) -> np.ndarray:
    """Largest value in each tile of TILE x TILE cells."""
    (hx, hy), t = field.shape, TILE
    padded = np.pad(field, ((0, -hx % t), (0, -hy % t)), mode="edge")
    return padded.reshape(-(-hx // t), t, -(-hy // t), t).max(axis=(1, 3))


def make_medium(
    grid: Grid, majorants: Sequence[tuple[np.ndarray, np.ndarray]], mu_a: np.ndarray, mu_s: np.ndarray, g: np.ndarray,
    layer: np.ndarray, layers: int, borders: Borders, z_edges_mm: np.ndarray, columns: tuple[int, int], z_top: float,
    real: type,
) -> Medium:  # fmt: skip
    """Executed medium of B bands.

    majorants : of `make_majorant`, of each band; mu_a, mu_s (1/mm), g (P, B), layer (P,): palette entries, of `layers`
    tissue layers; borders and z_edges_mm in mm from the top of the volume, which is z_top in the scene's coordinates.
    """
    period = np.array([borders.lx, borders.ly])
    depth_cells = grid.coarse_plane.size
    cells = np.array([columns[0] / period[0], columns[1] / period[1], depth_cells / z_edges_mm[-1]])
    last = np.array([columns[0] - 1, columns[1] - 1, depth_cells - 1], dtype=np.int32)
    rows, plane_row, first = [], [], 0
    for band, (majorant, plane_slab) in enumerate(majorants):
        thresholds = collision_thresholds(mu_a[:, band], mu_s[:, band], majorant[:, 2])
        rows.append(make_rows(thresholds, g[:, band], layer))
        plane_row.append(first + plane_slab * len(mu_a))
        first += rows[-1].size // ROW
    return Medium(
        borders, np.stack([_padded(majorant) for majorant, _ in majorants]),
        np.stack([flight_constants(majorant, real) for majorant, _ in majorants]), grid, cells.astype(real), last,
        np.concatenate(plane_row).astype(np.int32), np.concatenate(rows), layers, period.astype(real),
        float(z_top),
    )  # fmt: skip


def _padded(majorant: np.ndarray) -> np.ndarray:
    """A majorant with SLABS slabs: those added begin below everything."""
    return np.concatenate([majorant, np.tile([np.inf, 0.0, 0.0], (SLABS - len(majorant), 1))])


def make_rows(thresholds: np.ndarray, g: np.ndarray, layer: np.ndarray) -> np.ndarray:
    """What a collision reads, one row a (majorant slab, palette entry), see `gather.ROW`; (ROW slabs P,).

    thresholds (slabs, P, 2) int32; g, layer (P,).
    """
    slabs, entries = thresholds.shape[:2]
    rows = np.empty((slabs, entries, ROW), np.int32)
    rows[..., :2] = thresholds
    below_one = np.nextafter(np.float32(1.0), np.float32(0.0))  # a g that rounds to 1 would make 0/0 of the sampler
    rows[..., 2] = np.clip(g.astype(np.float32), -below_one, below_one).view(np.int32)
    rows[..., 3] = layer
    return rows.reshape(-1)
