"""Extremes of geometry: rays on faces, edges and corners; furrows; patches, pixels and cameras of any size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skinrender.analysis.closed_forms import half_space_radiance
from skinrender.analysis.stability_case import Case
from skinrender.analysis.stability_judges import alike, alike_in_picture, expects, judged, shows
from skinrender.analysis.stability_scenes import NORMAL, PENCIL, half_space, layer, slab
from skinrender.skin.spline import evaluate_grid

ALBEDO = 0.5
TISSUE = half_space(ALBEDO, 10.0, 60.0)
SEEN = half_space_radiance(ALBEDO, 1.0)
TURBID = layer(1.0, 0.5, 10.0, 0.5, 1.4)
CORNERS = ([0.0, 0.0], [1.0, 1.0], [0.0, 0.5], [0.5, 0.5], [0.25, 1.0])
FURROW_MM = 0.2
FURROW = np.where(np.abs(np.arange(64) - 31.5) < 12, -1e3 * FURROW_MM, 0.0)[None, :].repeat(4, axis=0)
"""Heights (rows, columns) in um of a furrow along y whose walls are as steep as one sample allows."""
RELIEF = {"kind": "height_map", "file": "furrow.npy", "um_per_unit": 1.0}


def pencil(place: list[float], **more: Any) -> dict[str, Any]:
    return {**PENCIL, "position_mm": place, **more}


def furrow_transmittance(mu_a: float, thickness_mm: float) -> float:
    """Share of an upright beam that passes the furrowed layer, by quadrature over its spline; matched index."""
    heights = -1e-3 * (FURROW.T - FURROW.mean())
    x = (np.arange(4096) + 0.5) / 4096
    surface = evaluate_grid(heights, (1.0, 1.0), x, np.array([0.5]))
    return float(np.exp(-mu_a * (thickness_mm - surface)).mean())


def view(**camera: Any) -> dict[str, Any]:
    return slab(TISSUE, camera=camera)


CASES = (
    Case(
        "light on faces, edges and corners of the patch",
        "a start on a face counted as outside; a flight along a face",
        [
            slab(layer(1.0, 1.0, 0.0), columns=4, light=pencil(place), sides=sides)
            for place in CORNERS
            for sides in ("open", "periodic", "dielectric")
        ],
        expects(*({"transmittance": math.exp(-1.0), "sides": 0.0} for _ in range(3 * len(CORNERS)))),
    ),
    Case(
        "light in the plane of voxel faces and beside it",
        "the voxel of a flight along a face; light through edges",
        [
            slab(TURBID, columns=8, light=pencil([0.5 + off, 0.5 + off], zenith_deg=45.0, azimuth_deg=90.0))
            for off in (0.0, 1e-7)
        ],
        judged(alike, alike_in_picture),
    ),
    Case(
        "view rays on edges and corners of voxels",
        "a ray that runs along a face counted in no voxel or in two",
        [
            slab(TISSUE, columns=4, camera={"center_mm": [0.625, 0.625], "zenith_deg": zenith, "azimuth_deg": azimuth})
            for zenith, azimuth in ((0.0, 0.0), (45.0, 0.0), (45.0, 45.0))
        ],
        shows(SEEN, *(half_space_radiance(ALBEDO, math.sqrt(0.5)) for _ in range(2))),
    ),
    Case(
        "a furrow of vertical walls, matched index",
        "flights that miss a wall; height and voxels that disagree",
        [slab(layer(1.0, 2.0, 0.0), relief=RELIEF)],
        expects({"transmittance": furrow_transmittance(2.0, 1.0), "reflectance": 0.0}),
        files={"furrow.npy": FURROW},
    ),
    Case(
        "a furrow of vertical walls, albedo 1",
        "re-entry through walls, reflections in the furrow, normals at its edges; energy",
        [
            slab(
                layer(1.0, 0.0, 10.0, 0.5, 1.4), relief=RELIEF, light={**NORMAL, "zenith_deg": zenith},
                camera={"zenith_deg": zenith, "cross_polarized": False},
            )
            for zenith in (0.0, 85.0)
        ],
        expects({"absorbed": 0.0}, {"absorbed": 0.0}),
        files={"furrow.npy": FURROW},
    ),
    Case(
        "a beam of radius 1e-6 mm and a pencil",
        "radius to 0: a beam that passes between the view rays; irradiance of 3e11 W per mm2",
        [
            slab(TURBID, light=pencil([0.45, 0.55])),
            slab(
                TURBID, light={**pencil([0.45, 0.55]), "radius_mm": 1e-6, "irradiance_W_per_mm2": 1.0 / (math.pi * 1e-12)}
            ),
        ],
        judged(alike, alike_in_picture),
    ),
    Case(
        "patches of 1e-3 to 1e4 mm",
        "periods crossed in one flight; tiles; kernels wider than the patch",
        [slab(TISSUE, size_mm=size) for size in (1.0, 1e-3, 0.1, 1e4)],
        judged(alike, shows(*[SEEN] * 4)),
    ),
    Case(
        "pictures of one pixel, one row, one column",
        "a lattice of rays on a line",
        [view(pixels=pixels) for pixels in ([1, 1], [1, 7], [5, 1])],
        shows(*[SEEN] * 3),
    ),
    Case(
        "windows of 1e-3 and of 10 patches, and a pinhole 1e7 mm away",
        "bins far smaller than kernels; periodic images of a photon; nearly parallel rays",
        [
            slab(TISSUE, camera={"window_mm": [0.03, 0.03]}, photons={"stored": 2e5}),
            view(window_mm=[10.0, 10.0]),
            view(kind="perspective", distance_mm=1e7),
        ],
        shows(*[SEEN] * 3),
    ),
    Case(
        "a lamp at 1e-3 and at 1e6 mm",
        "the solid angle of the patch near its half space and near 0",
        [
            slab(TURBID, light={"kind": "point", "height_mm": 1e-3, "spectrum": "E"}),
            slab(TURBID, light={"kind": "point", "height_mm": 1e6, "spectrum": "E"}),
            slab(TURBID),
        ],
        lambda outcomes: alike(outcomes[1:]),
    ),
)
