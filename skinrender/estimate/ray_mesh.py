"""A mesh of refracted view rays under a relief: which of them pass through a given point of the skin.

A view ray is named by the place (a, b) where it enters the surface z = h(a, b). Inside it is straight and goes down, so
it crosses every horizontal plane once, at

    P(a, b; z) = (a, b) + (z - h(a, b)) t(a, b),    t = the refracted direction's slopes (u_x, u_y) / u_z.

Nodes on a regular lattice of (a, b), aligned with the spline cells of the surface within which P is smooth, make
triangles. In a point's own plane each triangle is known exactly from its corners, so all triangles that hold the point
are found, folded ones and several sheets of a fold among them. P is continuous in (a, b) even where one ridge hides
another from the camera; what is hidden is tested afterwards, ray by ray.

To find the triangles a pyramid over the cells holds bounds of (a, b), h and t; in any plane they bound P.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinrender.estimate.film_plane import FilmPlane, view_direction
from skinrender.transport import allocating_kernel, kernel
from skinrender.transport.fresnel import refract
from skinrender.transport.height_field import height_and_gradient


class RayMesh(NamedTuple):
    """Refracted view rays of one band from the nodes of a lattice; lengths in mm.

    Parameters
    ----------
    x, y : (na + 1,), (nb + 1,) places of the nodes.
    node : (na + 1, nb + 1, 3) height h and slopes t.
    bounds : (cells of all levels, 10) f4, lowest and highest x, y, h, t_x, t_y; level by level from the single cells up.
    start : (levels + 1,) first row of each level.
    layer_mm : thickness of the layers over which a triangle's area is averaged.
    sag_mm : largest distance of the surface from the triangles between its points.
    size : (levels, 2) cells of each level along a and b; each is 2 x 2 of the level below.
    """

    x: np.ndarray
    y: np.ndarray
    node: np.ndarray
    bounds: np.ndarray
    start: np.ndarray
    size: np.ndarray
    layer_mm: float
    sag_mm: float


def make_ray_mesh(
    film: FilmPlane, heights: np.ndarray, size_mm: tuple[float, float], eta: float, box: np.ndarray, refine: int
) -> RayMesh:
    """Mesh of the rays that enter within a box.

    Parameters
    ----------
    heights : (hx, hy) control points of the surface; eta: n_outside / n_inside.
    box : (low x, low y, high x, high y), widened here to whole spline cells.
    refine : mesh cells along each side of a spline cell.
    """
    axes = []
    for axis in range(2):
        cell = size_mm[axis] / heights.shape[axis]
        low, high = math.floor(box[axis] / cell + 1e-9), math.ceil(box[2 + axis] / cell - 1e-9)
        axes.append(np.arange(refine * low, refine * max(high, low + 1) + 1) * (cell / refine))
    node = refracted_nodes(film, heights, *map(float, size_mm), eta, *axes)
    level = _cell_bounds(*axes, node)
    levels = [level]
    while level.shape[:2] != (1, 1):
        level = _pair_bounds(_pair_bounds(level).swapaxes(0, 1)).swapaxes(0, 1)
        levels.append(level)
    rows = [level.shape[0] * level.shape[1] for level in levels]
    return RayMesh(
        *axes, node, np.concatenate([level.reshape(-1, 10) for level in levels]),
        np.concatenate([[0], np.cumsum(rows)]), np.array([level.shape[:2] for level in levels]),
        float(min(axes[0][1] - axes[0][0], axes[1][1] - axes[1][0])),
        _sag_mm(node[:, :, 0]),
    )  # fmt: skip


@kernel
def entering_ray(film, heights, lx, ly, a, b):
    """The view ray that enters at (a, b).

    Returns
    -------
    h : height of the surface, mm; ux, uy, uz : the ray's direction outside; nx, ny, nz : inward unit normal.
    cos_i : cosine of the ray to the normal, not positive where the surface faces away; distance : from the pinhole.
    """
    h, slope_x, slope_y = height_and_gradient(heights, lx, ly, a, b)
    nz = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    nx, ny = -slope_x * nz, -slope_y * nz
    ux, uy, uz, distance = view_direction(film, a, b, h)
    return h, ux, uy, uz, nx, ny, nz, ux * nx + uy * ny + uz * nz, distance


@allocating_kernel
def refracted_nodes(film, heights, lx, ly, eta, x, y):
    """Height and slopes of the refracted ray at each node, (na + 1, nb + 1, 3).

    Where the surface faces away from the camera the rays go on as at grazing incidence, so that triangles on the border
    of what is seen have three corners.
    """
    node = np.empty((x.size, y.size, 3))
    for i in range(x.size):
        for j in range(y.size):
            h, ux, uy, uz, nx, ny, nz, cos_i, _ = entering_ray(film, heights, lx, ly, x[i], y[j])
            if cos_i < 0.0:
                ux, uy, uz, cos_i = ux - cos_i * nx, uy - cos_i * ny, uz - cos_i * nz, 0.0
            cos_t = math.sqrt(max(0.0, 1.0 - eta * eta * (1.0 - cos_i * cos_i)))
            dx, dy, dz = refract(ux, uy, uz, nx, ny, nz, eta, cos_i, cos_t)
            node[i, j, 0], node[i, j, 1], node[i, j, 2] = h, dx / dz, dy / dz
    return node


def _sag_mm(h: np.ndarray) -> float:
    """Bound of the distance between the surface and the triangles between its points h."""
    bends = [np.abs(np.diff(h, 2, axis=axis)).max(initial=0.0) for axis in range(2)]
    return float(0.25 * sum(bends) + 1e-6)


def _cell_bounds(x: np.ndarray, y: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Lowest and highest x, y, h, t_x, t_y over the corners of each cell, (na, nb, 10) f4, rounded outwards."""
    place = np.stack(np.broadcast_arrays(x[:, None], y[None, :]), axis=-1)
    values = np.concatenate([place, node], axis=-1).astype(np.float32)
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    low = np.nextafter(corners.min(axis=0), np.float32(-np.inf))
    high = np.nextafter(corners.max(axis=0), np.float32(np.inf))
    return np.stack([low, high], axis=-1).reshape(*low.shape[:2], 10)


def _pair_bounds(level: np.ndarray) -> np.ndarray:
    """Bounds of neighboring pairs along the first axis; an odd last one stays alone."""
    if len(level) % 2:
        level = np.concatenate([level, level[-1:]])
    low, high = level[0::2], level[1::2]
    pair = np.minimum(low, high)
    pair[..., 1::2] = np.maximum(low[..., 1::2], high[..., 1::2])
    return pair


@kernel
def reach_in_plane(bounds, row, z):
    """Box (low x, high x, low y, high y) that holds P over the cell of a row of bounds, in the plane z."""
    plane, slack = np.float32(z), np.float32(2e-6)
    below_low, below_high = plane - bounds[row, 5] - slack, plane - bounds[row, 4] + slack
    low_x, high_x = _product(below_low, below_high, bounds[row, 6], bounds[row, 7])
    low_y, high_y = _product(below_low, below_high, bounds[row, 8], bounds[row, 9])
    return (
        bounds[row, 0] + low_x - slack, bounds[row, 1] + high_x + slack,
        bounds[row, 2] + low_y - slack, bounds[row, 3] + high_y + slack,
    )  # fmt: skip


@kernel
def _product(a, b, c, d):
    """Interval product [a, b] [c, d]."""
    p, q, r, s = a * c, a * d, b * c, b * d
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@kernel
def find_rays(mesh, x, y, z, stack, found):
    """All triangles of rays that hold the point (x, y, z).

    Writes rows (a, b, h, spread) to found (n, 4): where the ray through the point enters, on the flat triangle between its
    corners, and the triangle's area in (a, b) over its area in the plane z. Entries more than `mesh.sag_mm` below the
    point's own height are left out. stack (m, 3) int: room to work. Returns their number, at most n.
    """
    bounds, start, size = mesh.bounds, mesh.start, mesh.size
    stack[0, 0], stack[0, 1], stack[0, 2] = size.shape[0] - 1, 0, 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        level, i, j = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        low_x, high_x, low_y, high_y = reach_in_plane(bounds, start[level] + i * size[level, 1] + j, z)
        if x < low_x or x > high_x or y < low_y or y > high_y:
            continue
        if level > 0:
            for k in range(4):
                a, b = 2 * i + (k & 1), 2 * j + (k >> 1)
                if a < size[level - 1, 0] and b < size[level - 1, 1]:
                    stack[depth, 0], stack[depth, 1], stack[depth, 2] = level - 1, a, b
                    depth += 1
            continue
        for half in range(2):
            count = _test_triangle(mesh, i, j, half, x, y, z, found, count)
    return count


@kernel
def _test_triangle(mesh, i, j, half, x, y, z, found, count):
    """Adds a cell's lower (half 0) or upper triangle to `found` if it holds the point; returns the new count."""
    i0, j0 = i + half, j + half
    step = 1 - 2 * half
    x0, y0 = _crossing(mesh, i0, j0, z)
    x1, y1 = _crossing(mesh, i0 + step, j0, z)
    x2, y2 = _crossing(mesh, i0, j0 + step, z)
    x1, y1, x2, y2, px, py = x1 - x0, y1 - y0, x2 - x0, y2 - y0, x - x0, y - y0
    area = x1 * y2 - x2 * y1
    if area == 0.0 or count >= found.shape[0]:
        return count
    v, w = (px * y2 - py * x2) / area, (x1 * py - y1 * px) / area
    if v < 0.0 or w < 0.0 or v + w > 1.0:
        return count
    h = (1.0 - v - w) * mesh.node[i0, j0, 0] + v * mesh.node[i0 + step, j0, 0] + w * mesh.node[i0, j0 + step, 0]
    if h > z + mesh.sag_mm:
        return count
    width_x, width_y = mesh.x[i + 1] - mesh.x[i], mesh.y[j + 1] - mesh.y[j]
    found[count, 0] = mesh.x[i0] + step * v * width_x
    found[count, 1] = mesh.y[j0] + step * w * width_y
    found[count, 2] = h
    found[count, 3] = width_x * width_y / _mean_area(mesh, i0, j0, step, z)
    return count + 1


@kernel
def _mean_area(mesh, i0, j0, step, z):
    """Mean of |twice a triangle's area| over the planes of the layer that holds z.

    The signed area is quadratic in z, and zero where the rays have a focus.
    """
    layer = mesh.layer_mm
    low = layer * math.floor(z / layer)
    x0, y0 = _crossing(mesh, i0, j0, low)
    x1, y1 = _crossing(mesh, i0 + step, j0, low)
    x2, y2 = _crossing(mesh, i0, j0 + step, low)
    x1, y1, x2, y2 = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    here, first, second = mesh.node[i0, j0], mesh.node[i0 + step, j0], mesh.node[i0, j0 + step]
    u1, v1 = layer * (first[1] - here[1]), layer * (first[2] - here[2])
    u2, v2 = layer * (second[1] - here[1]), layer * (second[2] - here[2])
    return mean_of_quadratic(x1 * y2 - x2 * y1, x1 * v2 + u1 * y2 - x2 * v1 - u2 * y1, u1 * v2 - u2 * v1)


@kernel
def mean_of_quadratic(c, b, a):
    """Mean of |c + b t + a t^2| over 0 <= t <= 1."""
    r, s = _roots_within(c, b, a)
    total, start = 0.0, 0.0
    for k in range(3):
        end = r if k == 0 else (s if k == 1 else 1.0)
        total += abs(c * (end - start) + b / 2.0 * (end**2 - start**2) + a / 3.0 * (end**3 - start**3))
        start = end
    return total


@kernel
def _roots_within(c, b, a):
    """The roots of c + b t + a t^2 in [0, 1], ascending, with 0 in the place of those that are not."""
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return 0.0, 0.0
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    r = q / a if a != 0.0 else 0.0
    s = c / q if q != 0.0 else 0.0
    r, s = r if 0.0 < r < 1.0 else 0.0, s if 0.0 < s < 1.0 else 0.0
    return min(r, s), max(r, s)


@kernel
def _crossing(mesh, i, j, z):
    """P of a node."""
    below = z - mesh.node[i, j, 0]
    return mesh.x[i] + below * mesh.node[i, j, 1], mesh.y[j] + below * mesh.node[i, j, 2]
