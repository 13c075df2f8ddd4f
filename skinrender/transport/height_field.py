"""A periodic height field z = h(x, y): its height, its gradient, and where a straight flight first crosses it.

The surface is the uniform biquadratic B-spline whose control points `heights[i, j]` stand at the cell centres
((i + 0.5) lx / hx, (j + 0.5) ly / hy) and repeat with the periods lx, ly: continuous with its normal, one polynomial
patch a cell. Lengths are in mm, z points down, so f = z - h(x, y) is positive inside the tissue.

Along a straight flight f is a quartic inside a cell. `first_hit` isolates its first sign change (see `quartic`), so no
crossing slips between samples however thin the ridge.
"""

from __future__ import annotations

import math

import numpy as np

from skinrender.transport import inlined_kernel, kernel
from skinrender.transport.optical_depth import lateral_exit
from skinrender.transport.quartic import first_sign_change

LIFT_MM = 1e-12
"""A start on the surface is lifted this far to its own side: more than rounding, less than the accuracy of a hit."""

START_TOLERANCE_MM = 1e-5
START_ROUNDING = 2.0**-22
"""A start at most START_TOLERANCE_MM + START_ROUNDING (lx + ly) on the wrong side is put on the surface: its position may have
been float32."""


def cell_bounds(heights: np.ndarray) -> np.ndarray:
    """Bounds of the surface over each cell: the extremes of its 3 x 3 control points (convex hull property).

    Parameters
    ----------
    heights : (hx, hy) control points, mm.

    Returns
    -------
    (hx, hy, 2) lowest and highest z, of the same dtype.
    """
    rows = [np.roll(heights, shift, axis=0) for shift in (-1, 0, 1)]
    low, high = np.minimum.reduce(rows), np.maximum.reduce(rows)
    cell_min = np.minimum.reduce([np.roll(low, shift, axis=1) for shift in (-1, 0, 1)])
    cell_max = np.maximum.reduce([np.roll(high, shift, axis=1) for shift in (-1, 0, 1)])
    return np.stack([cell_min, cell_max], axis=-1)


def bulge_bound(heights: np.ndarray, lx: float, ly: float) -> np.ndarray:
    """Largest second derivative, in any direction, with which the surface may bend down over each cell, (hx, hy), 1/mm.

    From the second differences of the 3 x 3 control points (they are the spline's own second derivatives); 0 where it
    bends up alone.
    """
    dx, dy = lx / heights.shape[0], ly / heights.shape[1]
    hxx = (np.roll(heights, -1, 0) - 2.0 * heights + np.roll(heights, 1, 0)) / dx**2
    hyy = (np.roll(heights, -1, 1) - 2.0 * heights + np.roll(heights, 1, 1)) / dy**2
    diagonal = np.roll(heights, (-1, -1), (0, 1)) - np.roll(heights, -1, 0) - np.roll(heights, -1, 1) + heights
    hxy = [np.roll(diagonal, shift, (0, 1)) / (dx * dy) for shift in ((0, 0), (1, 0), (0, 1), (1, 1))]
    straight = np.maximum(-hxx, -hyy)
    for axis in (0, 1):
        straight = np.maximum.reduce([np.roll(straight, shift, axis) for shift in (-1, 0, 1)])
    return np.maximum(straight + np.maximum.reduce(np.abs(hxy)), 0.0).astype(heights.dtype)


@inlined_kernel
def height(heights, lx, ly, x, y):
    """Height h(x, y) of the surface, mm."""
    hx, hy = heights.shape
    i0, i1, i2, a = _stencil(x * (hx / lx), hx)
    j0, j1, j2, b = _stencil(y * (hy / ly), hy)
    u, v, w = _blossom(b, b)
    z0 = u * heights[i0, j0] + v * heights[i0, j1] + w * heights[i0, j2]
    z1 = u * heights[i1, j0] + v * heights[i1, j1] + w * heights[i1, j2]
    z2 = u * heights[i2, j0] + v * heights[i2, j1] + w * heights[i2, j2]
    u, v, w = _blossom(a, a)
    return u * z0 + v * z1 + w * z2


@inlined_kernel
def height_and_gradient(heights, lx, ly, x, y):
    """Height h and its slopes dh/dx, dh/dy at (x, y); the upward unit normal is (h_x, h_y, -1) / norm."""
    hx, hy = heights.shape
    i0, i1, i2, a = _stencil(x * (hx / lx), hx)
    j0, j1, j2, b = _stencil(y * (hy / ly), hy)
    u, v, w = _blossom(b, b)
    du, dv, dw = b - 1.0, 1.0 - 2.0 * b, b
    z0 = u * heights[i0, j0] + v * heights[i0, j1] + w * heights[i0, j2]
    z1 = u * heights[i1, j0] + v * heights[i1, j1] + w * heights[i1, j2]
    z2 = u * heights[i2, j0] + v * heights[i2, j1] + w * heights[i2, j2]
    d0 = du * heights[i0, j0] + dv * heights[i0, j1] + dw * heights[i0, j2]
    d1 = du * heights[i1, j0] + dv * heights[i1, j1] + dw * heights[i1, j2]
    d2 = du * heights[i2, j0] + dv * heights[i2, j1] + dw * heights[i2, j2]
    u, v, w = _blossom(a, a)
    slope_x = ((a - 1.0) * z0 + (1.0 - 2.0 * a) * z1 + a * z2) * (hx / lx)
    slope_y = (u * d0 + v * d1 + w * d2) * (hy / ly)
    return u * z0 + v * z1 + w * z2, slope_x, slope_y


@inlined_kernel
def _periodic(cell, count):
    """Index of a cell; a division only where the period is left."""
    return cell if 0 <= cell < count else cell % count


@inlined_kernel
def _stencil(g, count):
    """The three periodic control points about cell coordinate g, and the fraction of its cell.

    Unsigned, as numba's test for negative indices costs as much as the look-up.
    """
    cell = math.floor(g)
    i1 = _periodic(cell, count)
    i0 = i1 - 1 if i1 > 0 else count - 1
    i2 = i1 + 1 if i1 < count - 1 else 0
    return np.uint64(i0), np.uint64(i1), np.uint64(i2), g - cell


@kernel
def slab_interval(z, uz, z_low, z_high, s_max):
    """Part [s_begin, s_end] of a flight within z_low <= z <= z_high; s_end < s_begin when there is none.

    Lets a far start (lamp, camera) skip the cells over which it cannot meet the surface.
    """
    if uz == 0.0:
        return (0.0, s_max) if z_low <= z <= z_high else (0.0, -1.0)
    s_a, s_b = (z_low - z) / uz, (z_high - z) / uz
    return max(0.0, min(s_a, s_b)), min(s_max, max(s_a, s_b))


@kernel
def first_hit(heights, cells, lx, ly, x, y, z, ux, uy, uz, s_max, side):
    """First crossing of the flight (x, y, z) + s (ux, uy, uz), 0 < s <= s_max, from its own side to the other.

    Parameters
    ----------
    heights : (hx, hy) control points, mm.
    cells : (hx, hy, 2 or more) their `cell_bounds`: lowest and highest z of each cell.
    lx, ly : periods, mm.
    s_max : finite; see `slab_interval` for flights from afar.
    side : +1.0 when the start is below the surface (f > 0, in the tissue), -1.0 when above. A start on the surface
        is taken to be on that side; it does not return itself unless it heads for the other side, which is then
        crossed at once (s about 0).

    Returns
    -------
    s : mm, with |f(s)| <= 1e-10 mm; -1.0 when there is no crossing; 0.0 when the start is beyond
        the tolerance on the other side already.
    """
    hx, hy = heights.shape
    gx, gy = x * (hx / lx), y * (hy / ly)
    dx, dy = ux * (hx / lx), uy * (hy / ly)
    cx, cy = math.floor(gx), math.floor(gy)
    i, j = np.uint64(_periodic(cx, hx)), np.uint64(_periodic(cy, hy))
    z, is_beyond = _on_its_side(heights, cells[i, j, 0], cells[i, j, 1], lx, ly, x, y, z, side)
    if is_beyond:
        return 0.0
    if dx < 0.0 and gx == cx:
        cx -= 1
    if dy < 0.0 and gy == cy:
        cy -= 1
    s_in, next_x, next_y = 0.0, lateral_exit(gx, dx, cx), lateral_exit(gy, dy, cy)
    across_x, across_y = 1.0 / abs(dx) if dx != 0.0 else 0.0, 1.0 / abs(dy) if dy != 0.0 else 0.0
    turn_x, turn_y = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    while s_in < s_max:
        s_out = max(s_in, min(min(next_x, next_y), s_max))
        z_in, z_out = z + uz * s_in, z + uz * s_out
        i, j = np.uint64(_periodic(cx, hx)), np.uint64(_periodic(cy, hy))
        if side > 0.0:
            may_cross = min(z_in, z_out) <= cells[i, j, 1]
        else:
            may_cross = max(z_in, z_out) >= cells[i, j, 0]
        if may_cross and s_out > s_in:
            t = _first_crossing_in_cell(
                heights, i, j, gx + dx * s_in - cx, gx + dx * s_out - cx, gy + dy * s_in - cy, gy + dy * s_out - cy,
                z_in, z_out, side,
            )  # fmt: skip
            if t >= 0.0:
                return s_in + t * (s_out - s_in)
        # without a branch, as over which side a flight goes on cannot be guessed; in long flights the sums drift by some 1e-8
        # cells, which a C1 surface does not mind
        over_x = next_x <= next_y
        cx += turn_x if over_x else 0
        cy += 0 if over_x else turn_y
        next_x += across_x if over_x else 0.0
        next_y += 0.0 if over_x else across_y
        s_in = s_out
    return -1.0


@inlined_kernel
def _on_its_side(heights, low, high, lx, ly, x, y, z, side):
    """z of a start, lifted off the surface; whether it is on the other side. low, high: bounds of its cell."""
    tolerance = START_TOLERANCE_MM + START_ROUNDING * (lx + ly)
    if low - tolerance <= z <= high + tolerance:
        start = side * (z - height(heights, lx, ly, x, y))
        return z + side * max(LIFT_MM - start, 0.0), start < -tolerance
    return z, (z < low) == (side > 0.0)


@kernel
def _first_crossing_in_cell(heights, i, j, a_in, a_out, b_in, b_out, z_in, z_out, side):
    """Fraction t in [0, 1] of the chord at which side * f first turns negative, or -1."""
    hx, hy, one = np.uint64(heights.shape[0]), np.uint64(heights.shape[1]), np.uint64(1)
    i0 = np.uint64(i - one if i > 0 else hx - one)
    i2 = np.uint64(i + one if i < hx - one else 0)
    p0, p1, p2 = _blend_row(heights, i0, j, hy, b_in, b_out)
    q0, q1, q2 = _blend_row(heights, i, j, hy, b_in, b_out)
    r0, r1, r2 = _blend_row(heights, i2, j, hy, b_in, b_out)
    u0, v0, w0 = _blossom(a_in, a_in)
    u1, v1, w1 = _blossom(a_in, a_out)
    u2, v2, w2 = _blossom(a_out, a_out)
    # product of quadratics in Bernstein form, summed over the three control rows
    h0 = u0 * p0 + v0 * q0 + w0 * r0
    h1 = 0.5 * (u0 * p1 + v0 * q1 + w0 * r1 + u1 * p0 + v1 * q0 + w1 * r0)
    h2 = (u0 * p2 + v0 * q2 + w0 * r2 + u2 * p0 + v2 * q0 + w2 * r0 + 4.0 * (u1 * p1 + v1 * q1 + w1 * r1)) / 6.0
    h3 = 0.5 * (u1 * p2 + v1 * q2 + w1 * r2 + u2 * p1 + v2 * q1 + w2 * r1)
    h4 = u2 * p2 + v2 * q2 + w2 * r2
    rise = 0.25 * (z_out - z_in)
    return first_sign_change(
        side * (z_in - h0),
        side * (z_in + rise - h1),
        side * (z_in + 2.0 * rise - h2),
        side * (z_in + 3.0 * rise - h3),
        side * (z_out - h4),
    )


@kernel
def _blossom(a, b):
    """Polar form of the three quadratic B-spline weights of a cell: w_k(a, a) are the weights at a."""
    return 0.5 * (1.0 - a) * (1.0 - b), 0.5 + 0.5 * (a + b) - a * b, 0.5 * a * b


@kernel
def _blend_row(heights, i, j, hy, b_in, b_out):
    """Bernstein coefficients, along the chord, of one row of control points blended in y."""
    one = np.uint64(1)
    c0 = heights[i, j - one if j > 0 else hy - one]
    c1 = heights[i, j]
    c2 = heights[i, np.uint64(j + one if j < hy - one else 0)]
    u, v, w = _blossom(b_in, b_in)
    first = u * c0 + v * c1 + w * c2
    u, v, w = _blossom(b_in, b_out)
    middle = u * c0 + v * c1 + w * c2
    u, v, w = _blossom(b_out, b_out)
    return first, middle, u * c0 + v * c1 + w * c2
