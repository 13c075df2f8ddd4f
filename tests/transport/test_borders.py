"""Refraction on the height field itself, whatever the voxels are."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.estimate.deposit import unpack_direction
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.spline import control_points
from skinrender.transport import kernel
from skinrender.transport.borders import (
    INSIDE, LEFT_SIDE, LEFT_TOP, PERIODIC, Borders, Majorant, cross, enter_surface, majorant_depth, stays_below,
)  # fmt: skip
from skinrender.transport.fresnel import fresnel
from skinrender.transport.height_field import first_hit, height, height_and_gradient
from skinrender.transport.lanes import (
    BORDER, FRESH, LANES, M, PATH, REGION, STRAIGHT, UNSCATTERED, UX, UY, UZ, X, Y, Z, Z_SAFE_BOTTOM, Z_SAFE_TOP,
    Z_START, new_block,
)  # fmt: skip
from skinrender.transport.medium import make_relief
from tests.stats import assert_share
from tests.volumes import Layer, beam, slab_volume, walk_rounds

N_TISSUE = 1.4
"""Of the refracted flights here; 1.4 is skin's."""


def tilted(slope_x, slope_y, size=1.0, samples=40):
    """Control points of a plane of these slopes through the middle of the patch; exact but for the seam."""
    center = (np.arange(samples) + 0.5) * (size / samples)
    return (slope_x * (center[:, None] - 0.5 * size) + slope_y * (center[None, :] - 0.5 * size)).astype(np.float32)


def dent(radius, rim, samples=200):
    """Control points of a spherical dent of the unit patch: z = h(x, y) within `rim` mm of the middle, level outside."""
    center = (np.arange(samples) + 0.5) / samples - 0.5
    r2 = np.minimum(center[:, None] ** 2 + center[None, :] ** 2, rim * rim)
    return control_points(np.sqrt(radius * radius - r2) - np.sqrt(radius * radius - rim * rim)).astype(np.float32)


def snell(direction, normal, eta):
    """Refracted unit direction by the tangential components (normal down into the tissue), eta = n_out / n_in."""
    tangential = eta * (direction - (direction @ normal) * normal)
    return tangential + np.sqrt(1.0 - tangential @ tangential) * normal


def borders_of(relief, size=1.0, n_out=1.0, n_in=N_TISSUE, bottom=2.0):
    rough = np.array([-1 if relief is None else 0, -1], np.int32)
    top = 0.0 if relief is None else float(relief.cell_max.max())
    return Borders(
        np.array([0.0, bottom]), rough, np.array([n_out, n_in, n_in]), np.array([top]), np.array([bottom]),
        np.array([size, size]), PERIODIC,
    )  # fmt: skip


def entering(heights, x, y, direction, n_in=N_TISSUE):
    """Fate of a photon aimed at (x, y) on z = 0 from the top of a relief: (entered, reflections, point, direction)."""
    top = min(0.0, float(heights.min())) - 1e-3
    relief = make_relief([heights - np.float32(top)], (1.0, 1.0))
    words = np.random.default_rng(1).integers(-(2**31), 2**31, 4 * LANES).astype(np.int32)
    back = -top / direction[2]
    start = (x - direction[0] * back, y - direction[1] * back, 0.0)
    entered, bounces, *rest = enter_surface(words, 0, borders_of(relief, n_in=n_in), relief, *start, *direction, False)
    return entered, bounces, np.array(rest[:3]) + [0.0, 0.0, top], np.array(rest[3:])


def direction_of(zenith_deg, azimuth_deg):
    zenith, azimuth = np.radians([zenith_deg, azimuth_deg])
    return np.array([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)])


@pytest.mark.parametrize("slopes", [(0.3, 0.0), (-0.2, 0.4), (1.0, -0.5)])
@pytest.mark.parametrize("zenith", [0.0, 30.0])
def test_tilted_interface_refracts_by_snells_law(slopes, zenith):
    heights = tilted(*slopes)
    normal = np.array([-slopes[0], -slopes[1], 1.0]) / np.hypot(1.0, np.hypot(*slopes))
    flown = direction_of(zenith, 200.0)
    for x, y in ((0.5, 0.5), (0.42, 0.61), (0.333, 0.48)):
        entered, bounces, point, out = entering(heights, x, y, flown)
        assert entered and bounces == 0
        assert point[2] == pytest.approx(slopes[0] * (point[0] - 0.5) + slopes[1] * (point[1] - 0.5), abs=1e-7)
        assert np.cross(point - [x, y, 0.0], flown) == pytest.approx(0.0, abs=1e-7)
        assert out == pytest.approx(snell(flown, normal, 1.0 / N_TISSUE), abs=1e-6)


def test_spherical_dent_refracts_by_snells_law_at_the_exact_normal():
    radius, rim = 0.5, 0.4
    heights = dent(radius, rim)
    center = np.array([0.5, 0.5, -np.sqrt(radius**2 - rim**2)])
    for zenith, x, y in ((0.0, 0.5, 0.5), (0.0, 0.62, 0.45), (20.0, 0.41, 0.55), (35.0, 0.3, 0.5)):
        flown = direction_of(zenith, 15.0)
        entered, bounces, point, out = entering(heights, x, y, flown)
        assert entered and bounces == 0
        assert np.linalg.norm(point - center) == pytest.approx(radius, abs=2e-6)
        normal = (point - center) / radius
        assert out == pytest.approx(snell(flown, normal, 1.0 / N_TISSUE), abs=2e-4)


@pytest.mark.parametrize("heights", [tilted(0.3, -0.2), dent(0.5, 0.4)], ids=["tilted", "dent"])
def test_refraction_does_not_depend_on_the_size_of_the_voxels(heights):
    """The same photons to the last bit, at 5, 50 and 200 columns and 1 to 400 planes."""
    maps = []
    for columns, planes in ((5, 1), (50, 20), (200, 400)):
        volume = slab_volume([Layer(1.0, 1.0, 3.0)], columns=(columns, columns), planes=[planes], surface=heights)
        walked = walk_rounds(PhotonPass(volume, beam(10.0), 5), 3000, store=True)[0]
        maps.append((walked.tallies.tolist(), walked.position.tobytes(), walked.direction.tobytes()))
    assert maps[0] == maps[1] == maps[2]


def test_stored_directions_are_those_refracted_at_a_tilted_interface():
    slopes = (0.25, 0.1)
    volume = slab_volume([Layer(1.0, 20.0, 1.0, g=0.0)], columns=(50, 50), planes=[20], surface=tilted(*slopes))
    walked = walk_rounds(PhotonPass(volume, beam(15.0, 30.0), 6), 20_000, store=True)[0]
    middle = np.all(np.abs(walked.position[:, :2] - 0.5) < 0.3, axis=1)
    directions = np.array([unpack_direction(a, b) for a, b in walked.direction[middle]])
    normal = np.array([-slopes[0], -slopes[1], 1.0]) / np.sqrt(1.0 + slopes[0] ** 2 + slopes[1] ** 2)
    expected = snell(direction_of(15.0, 30.0), normal, 1.0 / N_TISSUE)
    unturned = np.linalg.norm(directions - expected, axis=1) < 1e-4
    assert len(directions) > 100 and unturned.mean() > 0.9
