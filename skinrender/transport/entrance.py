"""Entrance: how the histories that arrive from a lamp get into the skin (Fresnel, drawn, not weighted).

    meet_plane or meet_relief -> pass_surface -> enter_later (under a relief) -> settle

Each step takes all lanes of the block of arrivals: arithmetic vectorizes, and what does not overlaps better. A history
arrives in 12 ns in place of 20 when one came after the other, under a relief in 98 in place of 116.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel, kernel
from skinrender.transport.borders import BORDER_Z, SAFE_TOP, enter_surface, index_of, place
from skinrender.transport.fresnel import fresnel
from skinrender.transport.height_field import first_hit, height
from skinrender.transport.lanes import (
    BAND,
    BORDER,
    EDGE,
    ENDED,
    FRESH,
    LANES,
    LISTED,
    PATH,
    SLAB_DEPTH,
    SLABS,
    STRAIGHT,
    UNSCATTERED,
    UX,
    UY,
    UZ,
    Z_START,
    X,
    Y,
    Z,
    whole_groups,
)
from skinrender.transport.relief import ROUGH, rough_normal
from skinrender.transport.rng import draw

# What is found at the surface, in rows that only flights use: its normal, into the skin; 1: it is met, and it is passed.
# Lanes that are not in have no meaning.
NX, NY, NZ = PATH, Z_START, EDGE
IS_MET, IS_IN = BORDER, ENDED


@kernel
def enter(f, w, n, band, z_mean, medium, relief, store_first):
    """Takes n lanes of a band, put on the mean plane at depth z_mean, into the skin.

    Lists those that enter, returns their number. What vectorizes takes whole groups, whatever is in their other lanes.
    """
    borders, whole = medium.borders, whole_groups(n)
    for i in range(whole):
        w[BAND + i] = band
        w[FRESH + i] = UNSCATTERED if store_first else UNSCATTERED | STRAIGHT
    if relief is not None and borders.table[0, ROUGH] >= 0.0:
        meet_relief(f, w, n, z_mean, borders, relief)
    else:
        meet_plane(f, w, whole, z_mean, borders.table[0, BORDER_Z])
    pass_surface(f, w, whole, index_of(borders, band, -1), index_of(borders, band, 0))
    if relief is not None and borders.table[0, ROUGH] >= 0.0:
        enter_later(f, w, n, borders, relief)
    return settle(f, w, n, band, medium, relief)


@block_kernel
def meet_plane(f, w, n, z_mean, z):
    """Flight of n lanes to a flat surface at z."""
    for i in range(n):
        s = (z - z_mean) / np.float64(f[UZ + i])
        f[X + i], f[Y + i] = f[X + i] + f[UX + i] * s, f[Y + i] + f[UY + i] * s
        f[Z + i] = z
        f[NX + i], f[NY + i], f[NZ + i] = 0.0, 0.0, 1.0
        w[IS_MET + i] = np.int32(1)


@kernel
def meet_relief(f, w, n, z_mean, borders, relief):
    """Flight of n lanes from the top z = 0 to a height field, which rounding might let one miss."""
    heights, bounds, lx, ly = relief.heights[0], relief.bounds[0], borders.lx, borders.ly
    for i in range(n):
        ux, uy, uz = np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i])
        back = z_mean / uz
        x, y = np.float64(f[X + i]) - ux * back, np.float64(f[Y + i]) - uy * back
        reach = (borders.table[0, SAFE_TOP] + 1e-3) / uz
        s = first_hit(heights, bounds, lx, ly, x, y, 0.0, ux, uy, uz, reach, -1.0)
        f[X + i], f[Y + i], f[Z + i] = x + ux * s, y + uy * s, uz * s
        w[IS_MET + i] = np.int32(s >= 0.0)
    for i in range(n):
        f[NX + i], f[NY + i], f[NZ + i] = rough_normal(heights, lx, ly, np.float64(f[X + i]), np.float64(f[Y + i]))


@block_kernel
def pass_surface(f, w, n, index_out, index_in):
    """Refracts n lanes at the surface that they have met, or mirrors them.

    `fresnel.refract` and `reflect` in one, without a branch; a word is drawn also where nothing can be reflected.
    """
    eta = index_out / index_in
    for i in range(n):
        ux, uy, uz = np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i])
        nx, ny, nz = np.float64(f[NX + i]), np.float64(f[NY + i]), np.float64(f[NZ + i])
        cos_i = min(1.0, max(0.0, ux * nx + uy * ny + uz * nz))
        reflectance, cos_t = fresnel(cos_i, eta)
        is_reflected = draw(w, i, LANES) < reflectance
        along = 1.0 if is_reflected else eta
        shift = -2.0 * cos_i if is_reflected else cos_t - eta * cos_i
        f[UX + i], f[UY + i], f[UZ + i] = along * ux + shift * nx, along * uy + shift * ny, along * uz + shift * nz
        w[IS_IN + i] = np.int32(0) if is_reflected else w[IS_MET + i]


@kernel
def enter_later(f, w, n, borders, relief):
    """Follows those of n lanes that a height field has mirrored, until they enter all the same or escape."""
    for i in range(n):
        if w[IS_MET + i] != w[IS_IN + i]:
            x, y = np.float64(f[X + i]), np.float64(f[Y + i])
            z = height(relief.heights[0], borders.lx, borders.ly, x, y)
            ux, uy, uz = np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i])
            is_in, x, y, z, ux, uy, uz = enter_surface(w, i, borders, relief, x, y, z, ux, uy, uz)
            f[X + i], f[Y + i], f[Z + i], f[UX + i], f[UY + i], f[UZ + i] = x, y, z, ux, uy, uz
            w[IS_IN + i] = np.int32(is_in)
            w[FRESH + i] = UNSCATTERED


@kernel
def settle(f, w, n, band, medium, relief):
    """Lets n lanes begin their first flight; lists those that are in, returns their number."""
    borders, entered = medium.borders, 0
    rough = int(borders.table[0, ROUGH])
    for i in range(n):
        for k in range(2 * SLABS - 1):
            f[SLAB_DEPTH + k * LANES + i] = medium.slabs[band, k]
        place(
            f, w, i, borders, medium.majorant, relief, np.int64(0), np.float64(f[X + i]), np.float64(f[Y + i]),
            np.float64(f[Z + i]), np.float64(f[UX + i]), np.float64(f[UY + i]), np.float64(f[UZ + i]), rough, 1.0
        )  # fmt: skip
        w[LISTED + entered] = i
        entered += w[IS_IN + i]
    return entered
