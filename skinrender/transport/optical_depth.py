"""A straight flight through the voxels: which tissue it meets, and its optical depth for all bands at once.

Voxels are columns of equal width under the patch, repeated with its period; planes may differ in height.
"""

from __future__ import annotations

import math

from skinrender.transport import inlined_kernel, kernel


@kernel
def edges_above(z_edges, z):
    """Number of edges at depth z or above it, by bisection; compiling numpy's `searchsorted` takes half a second."""
    low, high = 0, z_edges.size
    while low < high:
        middle = (low + high) // 2
        if z_edges[middle] <= z:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def plane_of(z_edges, z, dz):
    """Index of the voxel plane that a flight from depth z enters; on an edge, the one it flies into."""
    k = edges_above(z_edges, z) - 1
    if dz < 0.0 and k >= 0 and z_edges[k] == z:
        k -= 1
    return min(max(k, 0), z_edges.size - 2)


@kernel
def lateral_exit(position, velocity, cell):
    """Path at which a flight leaves its cell along one lateral axis, in cell units."""
    if velocity > 0.0:
        return (cell + 1 - position) / velocity
    if velocity < 0.0:
        return (cell - position) / velocity
    return math.inf


@kernel
def plane_exit(z_edges, z, dz, k):
    """Path at which a flight leaves its plane; never at the top and the bottom of the volume."""
    if dz > 0.0 and k < z_edges.size - 2:
        return (z_edges[k + 1] - z) / dz
    if dz < 0.0 and k > 0:
        return (z_edges[k] - z) / dz
    return math.inf


@kernel
def first_cell(position, velocity):
    """Cell that a flight enters along one lateral axis (position in cell units)."""
    cell = math.floor(position)
    return cell - 1 if velocity < 0.0 and position == cell else cell


def for_each_stretch(enter):
    """A kernel that calls ``enter(sink, palette entry, mm)``, a kernel too, for each stretch of a flight in one tissue.

    The flight is (x, y, z) + s (dx, dy, dz), 0 <= s <= length (mm); palette_index (nx, ny, nz), z_edges (nz + 1,).
    """

    @kernel
    def follow(palette_index, z_edges, lx, ly, x, y, z, dx, dy, dz, length, sink):
        nx, ny, _ = palette_index.shape
        gx, gy, vx, vy = x * (nx / lx), y * (ny / ly), dx * (nx / lx), dy * (ny / ly)
        cx, cy, k = first_cell(gx, vx), first_cell(gy, vy), plane_of(z_edges, z, dz)
        palette, run, s = palette_index[cx % nx, cy % ny, k], 0.0, 0.0
        while s < length:
            exit_x, exit_y, exit_z = lateral_exit(gx, vx, cx), lateral_exit(gy, vy, cy), plane_exit(z_edges, z, dz, k)
            leave = max(s, min(min(exit_x, exit_y), min(exit_z, length)))
            run += leave - s
            s = leave
            if exit_z <= exit_x and exit_z <= exit_y:
                k += 1 if dz > 0.0 else -1
            elif exit_x <= exit_y:
                cx += 1 if vx > 0.0 else -1
            else:
                cy += 1 if vy > 0.0 else -1
            following = palette_index[cx % nx, cy % ny, k] if s < length else palette
            if following != palette or s >= length:
                enter(sink, palette, run)
                palette, run = following, 0.0

    return follow


@inlined_kernel
def _add_depths(sink, entry, run):
    mu_t, tau = sink
    for b in range(tau.size):
        tau[b] += mu_t[entry, b] * run


_add_each = for_each_stretch(_add_depths)


@kernel
def add_optical_depth(palette_index, z_edges, lx, ly, mu_t, x, y, z, dx, dy, dz, length, tau):
    """Adds to tau (B,) the optical depth of a flight, see `for_each_stretch`; mu_t (P, B) in 1/mm."""
    _add_each(palette_index, z_edges, lx, ly, x, y, z, dx, dy, dz, length, (mu_t, tau))
