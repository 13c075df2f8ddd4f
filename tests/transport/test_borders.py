"""Refraction on the height field itself, whatever the voxels are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinrender.estimate.deposit import unpack_direction
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.spline import control_points, evaluate_grid
from skinrender.transport import kernel, lanes, tally
from skinrender.transport.entrance import IS_IN, IS_MET, NX, NY, NZ, enter, pass_surface
from skinrender.transport.fresnel import fresnel, reflect, refract
from skinrender.transport.height_field import first_hit, height
from skinrender.transport.lanes import LANES, new_block
from skinrender.transport.medium import make_relief
from skinrender.transport.relief import OFFSET_MM, below_all_around, below_each_bulge, look_around
from tests.stats import assert_same_means, assert_share
from tests.transport.block import row
from tests.volumes import Layer, beam, fractions, furrow, sky, slab_volume, walk_rounds

N_TISSUE = 1.4
"""Of the refracted flights here; 1.4 is skin's."""


def tilted(slope_x, slope_y, size=1.0, samples=40):
    """Control points of a plane of these slopes through the middle of the patch; exact but for the seam."""
    center = (np.arange(samples) + 0.5) * (size / samples)
    return (slope_x * (center[:, None] - 0.5 * size) + slope_y * (center[None, :] - 0.5 * size)).astype(np.float32)


def dent(radius, rim, samples=200):
    """Control points of a spherical dent within `rim` mm of the middle of the unit patch, level 0 around it."""
    center = (np.arange(samples) + 0.5) / samples - 0.5
    r2 = np.minimum(center[:, None] ** 2 + center[None, :] ** 2, rim * rim)
    return control_points(np.sqrt(radius * radius - r2) - np.sqrt(radius * radius - rim * rim)).astype(np.float32)


def snell(direction, normal, eta):
    """Refracted unit direction by the tangential components (normal down into the tissue), eta = n_out / n_in."""
    tangential = eta * (direction - (direction @ normal) * normal)
    return tangential + np.sqrt(1.0 - tangential @ tangential) * normal


def entering(heights, x, y, direction):
    """Fate of a history aimed at (x, y) on the mean plane: (is in, without a reflection before, point, direction)."""
    volume = slab_volume([Layer(2.0, 1.0, 1.0, n=N_TISSUE)], surface=heights)
    world, top = PhotonPass(volume, beam(), 1, real=np.float64), volume.z_edges_mm[0]
    f, w = new_block(np.float64)
    w[: 4 * LANES] = np.random.default_rng(1).integers(-(2**31), 2**31, 4 * LANES)
    for start, value in zip((lanes.X, lanes.Y, lanes.UX, lanes.UY, lanes.UZ), (x, y, *direction)):
        f[start] = value
    entered = enter(f, w, 1, 0, -top, world._medium(np.float64), world._relief, False)
    point, out = np.array([f[lanes.X], f[lanes.Y], f[lanes.Z]]), np.array([f[lanes.UX], f[lanes.UY], f[lanes.UZ]])
    return entered == 1, w[lanes.FRESH] & lanes.STRAIGHT != 0, point + [0.0, 0.0, top], out


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
        entered, straight, point, out = entering(heights, x, y, flown)
        assert entered and straight
        assert point[2] == pytest.approx(slopes[0] * (point[0] - 0.5) + slopes[1] * (point[1] - 0.5) + OFFSET_MM, abs=1e-7)
        assert np.cross(point - [x, y, OFFSET_MM], flown) == pytest.approx(0.0, abs=1e-7)
        assert out == pytest.approx(snell(flown, normal, 1.0 / N_TISSUE), abs=1e-6)


@pytest.mark.parametrize("index_out, index_in", [(1.0, 1.4), (1.4, 1.4), (1.5, 1.0)])
def test_the_surface_is_passed_by_fresnel_and_snell(index_out, index_in):
    """A lane at a time: reflectance in the share of lanes, and both directions by their formulas; total reflection too."""
    rng = np.random.default_rng(3)
    f, w = new_block(np.float64)
    w[: 4 * LANES] = rng.integers(-(2**31), 2**31, 4 * LANES)
    u, n = (each / np.linalg.norm(each, axis=0) for each in rng.normal(size=(2, 3, LANES)))
    n *= np.sign((u * n).sum(axis=0))
    for starts, values in (((lanes.UX, lanes.UY, lanes.UZ), u), ((NX, NY, NZ), n)):
        for start, value in zip(starts, values):
            row(f, start)[:] = value
    is_met = rng.random(LANES) < 0.9
    row(w, IS_MET)[:] = is_met
    pass_surface(f, w, LANES, index_out, index_in)
    eta, expected, variance = index_out / index_in, 0.0, 0.0
    for i in range(LANES):
        cos_i = (u[:, i] * n[:, i]).sum()
        reflectance, cos_t = fresnel(cos_i, eta)
        expected, variance = expected + reflectance, variance + reflectance * (1.0 - reflectance)
        out = np.array([f[start + i] for start in (lanes.UX, lanes.UY, lanes.UZ)])
        is_mirrored = (out * n[:, i]).sum() < 0.0
        assert w[IS_IN + i] == (is_met[i] and not is_mirrored)
        right = reflect(*u[:, i], *n[:, i]) if is_mirrored else refract(*u[:, i], *n[:, i], eta, cos_i, cos_t)
        assert out == pytest.approx(right, abs=1e-12)
        assert is_mirrored or reflectance < 1.0
    mirrored = np.count_nonzero(sum(row(f, start) * value for start, value in zip((lanes.UX, lanes.UY, lanes.UZ), n)) < 0.0)
    assert abs(mirrored - expected) <= 4.0 * np.sqrt(variance)


def test_spherical_dent_refracts_by_snells_law_at_the_exact_normal():
    radius, rim = 0.5, 0.4
    heights = dent(radius, rim)
    center = np.array([0.5, 0.5, -np.sqrt(radius**2 - rim**2)])
    for zenith, x, y in ((0.0, 0.5, 0.5), (0.0, 0.62, 0.45), (20.0, 0.41, 0.55), (35.0, 0.3, 0.5)):
        flown = direction_of(zenith, 15.0)
        entered, straight, point, out = entering(heights, x, y, flown)
        assert entered and straight
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


@kernel
def doubtful_flights(f, w, relief, lx, ly, directions, starts, path, out):
    """For flights from a height field's lower side: (below all around, below each bulge, first crossing or -1)."""
    for i in range(path.size):
        x, y, z = starts[i, 0], starts[i, 1], starts[i, 2]
        ux, uy, uz = directions[i, 0], directions[i, 1], directions[i, 2]
        f[lanes.X], f[lanes.Y], f[lanes.Z], f[lanes.Z_START] = x + ux * path[i], y + uy * path[i], z + uz * path[i], z
        f[lanes.UX], f[lanes.UY], f[lanes.UZ], f[lanes.PATH] = ux, uy, uz, path[i]
        look_around(f, w, 1, np.float32(lx), np.float32(ly), relief.tiles_per_mm, relief.last_tile)
        out[i, 0] = below_all_around(f, w, 0, relief.around, 0)
        out[i, 1] = below_each_bulge(f, w, 0, relief, 0, lx, ly)
        out[i, 2] = first_hit(relief.heights[0], relief.bounds[0], lx, ly, x, y, z, ux, uy, uz, path[i], 1.0)


@pytest.mark.parametrize("roughness", [0.02, 0.3])
@pytest.mark.parametrize("cells", [(24, 16), (21, 19)], ids=["whole tiles", "part of a tile"])
def test_a_flight_said_to_stay_below_crosses_nothing(roughness, cells):
    rng = np.random.default_rng(3)
    heights = (roughness * rng.normal(size=cells)).astype(np.float32)
    relief = make_relief([heights], (2.0, 1.0))
    n = 200_000
    directions = rng.normal(size=(n, 3))
    directions = (directions / np.linalg.norm(directions, axis=1)[:, None]).astype(np.float32)
    path = rng.exponential(0.2, n).astype(np.float32)
    ends = rng.uniform(0.0, 1.0, (n, 2)) * [2.0, 1.0]
    starts = np.empty((n, 3), np.float32)
    starts[:, :2] = ends - directions[:, :2] * path[:, None]
    surface = np.array([height(relief.heights[0], 2.0, 1.0, float(x), float(y)) for x, y in starts[:, :2]])
    starts[:, 2] = surface + rng.exponential(roughness, n) + 1e-6
    out, (f, w) = np.empty((n, 3)), new_block(np.float32)
    doubtful_flights(f, w, relief, 2.0, 1.0, directions, starts, path, out)
    deeper, smoother, hit = out[:, 0] == 1.0, out[:, 1] == 1.0, out[:, 2] >= 0.0
    assert not np.any((deeper | smoother) & hit)
    assert hit.sum() > 1000 and (deeper | smoother).sum() > 0.3 * (~hit).sum()


def unscattered_through(surface, flown, mu_a, thickness):
    """Mean of exp(-mu_a l), l the length inside a relief that refracts nothing, over the patch of 1 mm2."""
    s = np.linspace(0.0, (thickness - surface.min()) / flown[2], 4001)
    s = 0.5 * (s[1:] + s[:-1])
    x = (np.arange(2000) + 0.5) / 2000
    h = evaluate_grid(surface, (1.0, 1.0), np.linspace(0.0, 1.0, 4000, endpoint=False), np.array([0.5]))[:, 0]
    z = surface.min() + s * flown[2]
    at = ((x[:, None] + s * flown[0]) % 1.0 * 4000).astype(int)
    length = (z > h[at]).sum(axis=1) * (s[1] - s[0])
    return np.exp(-mu_a * length).mean()


@pytest.mark.parametrize("zenith", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("depth", [0.1, 0.8])
def test_light_straight_through_a_furrow_is_dimmed_by_the_tissue_on_its_way(zenith, depth):
    """Equal indices: flights leave and enter again through both walls, and nothing turns them."""
    surface, mu_a = furrow(depth), 1.5
    volume = slab_volume([Layer(1.0, mu_a, 0.0, n=1.0)], surface=surface, planes=[10])
    flown = direction_of(zenith, 0.0)
    walked = walk_rounds(PhotonPass(volume, beam(zenith), 7), 20_000, 2)
    transmitted = sum(one.tallies[0, tally.TRANSMITTED_UNSCATTERED] for one in walked)
    assert_share(transmitted, 40_000, unscattered_through(surface, flown, mu_a, 1.0), 6)


@pytest.mark.parametrize("surface", [furrow(0.8), tilted(0.5, 0.3), dent(0.5, 0.4)], ids=["furrow", "saw", "dent"])
@pytest.mark.parametrize("light", [beam(0.0), beam(60.0), beam(89.9), sky()], ids=["0", "60", "89.9", "sky"])
def test_steep_walls_lose_no_photon(surface, light):
    volume = slab_volume([Layer(1.0, 0.5, 20.0)], columns=(20, 20), planes=[20], surface=surface)
    walked = walk_rounds(PhotonPass(volume, light, 8), 4000, 3, store=True)
    assert sum(one.tallies[0, tally.REFLECTED] for one in walked) > 0


def test_walls_of_a_very_wide_patch_lose_no_photon():
    """Positions are rounded to 3e-5 mm there. Light from above bends away from a furrow: all that enters leaves below."""
    surface = furrow(7.0, 140.0, size=700.0)
    wide = slab_volume([Layer(4.0, 0.0, 0.0, n=1.4)], surface=surface, size=(700.0, 700.0), planes=[4], below=1.4)
    walked = walk_rounds(PhotonPass(wide, beam(), 4), 20_000)[0].tallies[0]
    assert walked[tally.TRANSMITTED] + walked[tally.SPECULAR] == 20_000


@pytest.mark.parametrize("light", [beam(0.0), beam(75.0), sky()], ids=["normal", "oblique", "sky"])
def test_clear_relief_as_inner_border_is_the_same_relief(light):
    """The surface's code against the inner border's: a layer of index 1 above the same height field."""
    surface = dent(0.5, 0.4, samples=48) + furrow(0.3, samples=48)[:, :1]
    tissue, air = Layer(1.0, 0.0, 0.0), Layer(0.5, 0.0, 0.0, n=1.0)
    plain = slab_volume([tissue], surface=surface)
    inner = replace(slab_volume([air, tissue]), border_mm=(surface + np.float32(air.thickness))[None])
    walks = [walk_rounds(PhotonPass(volume, light, seed), 1500, 20) for volume, seed in ((plain, 1), (inner, 2))]
    columns = [tally.REFLECTED, tally.TRANSMITTED, tally.REFLECTED_UNSCATTERED]
    assert_same_means(*([one.tallies[0, columns] for one in walked] for walked in walks))


@pytest.mark.parametrize("zenith", [0.0, 60.0, 85.0, 89.9])
def test_level_relief_reflects_as_a_plane(zenith):
    """Also on a patch much narrower than the way that light at grazing incidence has from the relief's top."""
    surface = np.zeros((4, 4), np.float32)
    surface[0, 0] = -1e-5
    eta = 1.0 / N_TISSUE
    expected = fresnel(np.cos(np.radians(zenith)), eta)[0]
    for size in (1.0, 0.1):
        volume = slab_volume([Layer(1.0, 50.0, 0.0)], surface=surface, planes=[4], size=(size, size))
        volume = replace(volume, z_edges_mm=np.concatenate([[-0.1], volume.z_edges_mm[1:]]))
        walked = walk_rounds(PhotonPass(volume, beam(zenith, 20.0), 9), 10_000)[0]
        assert_share(walked.tallies[0, tally.SPECULAR], 10_000, expected, 8)


def test_zero_relief_walks_the_same_histories_as_none():
    """A pencil, whose first scatterings are stored with and without relief: the same photons but for what a start off the
    surface shifts a flight, by cosines down to 0.01."""
    light, layers = beam(30.0, radius=0.0), [Layer(0.5, 1.0, 10.0, g=0.5)]
    flat, zero = (slab_volume(layers, planes=[5], surface=s) for s in (None, np.zeros((8, 8), np.float32)))
    walks = [walk_rounds(PhotonPass(v, light, 10), 300, store=True)[0] for v in (flat, zero)]
    assert np.array_equal(walks[0].tallies[0, tally.REFLECTED :], walks[1].tallies[0, tally.REFLECTED :])
    assert np.allclose(walks[0].position, walks[1].position, atol=100 * OFFSET_MM)


def test_zero_relief_reflects_as_none():
    layers = [Layer(0.3, 1.0, 20.0), Layer(1.0, 0.2, 10.0)]
    flat, zero = (slab_volume(layers, planes=[4, 4], surface=s) for s in (None, np.zeros((8, 8), np.float32)))
    walks = [fractions(walk_rounds(PhotonPass(v, sky(), seed), 4000, 20)) for v, seed in ((flat, 11), (zero, 12))]
    assert_same_means(*walks)


def both_ways(zenith, n):
    """Reflectance of a clear plate in air, all reflections inside included."""
    r = fresnel(np.cos(np.radians(zenith)), 1.0 / n)[0]
    return 2.0 * r / (1.0 + r)


@pytest.mark.parametrize("zenith", [0.0, 50.0, 80.0, 89.0])
def test_clear_plate(zenith):
    volume = slab_volume([Layer(0.7, 0.0, 0.0, n=1.5)], below=1.0)
    walked = walk_rounds(PhotonPass(volume, beam(zenith), 13), 20_000)[0].tallies[0]
    assert walked[tally.TRANSMITTED_UNSCATTERED] + walked[tally.REFLECTED_UNSCATTERED] == 20_000
    assert_share(walked[tally.REFLECTED_UNSCATTERED], 20_000, both_ways(zenith, 1.5), 4)


def test_two_clear_plates_with_an_index_step_between():
    """Fluxes through three borders, each drawn: closed form of two nested plates at normal incidence."""
    r = [((a - b) / (a + b)) ** 2 for a, b in ((1.0, 1.6), (1.6, 1.2), (1.2, 1.0))]
    through = (1.0 - r[1]) * (1.0 - r[2]) / (1.0 - r[1] * r[2])
    transmitted = (1.0 - r[0]) * through / (1.0 - r[0] * (1.0 - through))
    volume = slab_volume([Layer(0.3, 0.0, 0.0, n=1.6), Layer(0.4, 0.0, 0.0, n=1.2)], below=1.0, planes=[2, 3])
    walked = walk_rounds(PhotonPass(volume, beam(), 14), 40_000)[0].tallies[0]
    assert_share(walked[tally.TRANSMITTED_UNSCATTERED], 40_000, transmitted)


@pytest.mark.parametrize("sides, inside", [("open", 0), ("dielectric", 1)])
def test_a_pencil_leaves_through_an_open_side_and_is_kept_by_total_reflection(sides, inside):
    """At 60 degrees the refracted flight meets the wall beyond the critical angle, and then the bottom."""
    volume = slab_volume([Layer(1.0, 0.0, 0.0, n=1.5)], below=1.5, sides=sides)
    walked = walk_rounds(PhotonPass(volume, beam(60.0, radius=0.0), 15), 5000)[0].tallies[0]
    entered = 5000 - walked[tally.SPECULAR]
    assert walked[tally.TRANSMITTED if inside else tally.SIDES] == entered


def test_dielectric_side_reflects_by_fresnel():
    """A steep pencil meets the wall once, at less than the critical angle of a weak step."""
    volume = slab_volume([Layer(3.0, 0.0, 0.0, n=1.05)], below=1.05, sides="dielectric")
    zenith = 60.0
    sin_t = np.sin(np.radians(zenith)) / 1.05
    expected = fresnel(sin_t, 1.05)[0]
    walked = walk_rounds(PhotonPass(volume, beam(zenith, radius=0.0, position=(0.9, 0.5)), 16), 40_000)[0].tallies[0]
    entered = 40_000 - walked[tally.SPECULAR]
    # what the first wall reflects meets the other one as well before it reaches the bottom
    assert 0.0 < expected < 0.5
    assert_share(walked[tally.SIDES], entered, 1.0 - expected**2)
