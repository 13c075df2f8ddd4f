"""The lattice of view rays: a photon finds the rays that pass near it, in any view and on any relief."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.engine.view import picture_plane
from skinrender.estimate.lattice import NO_RAY, SEVERAL_RAYS, RayLattice, bin_of, make_lattice
from skinrender.estimate.ray_paths import follow_rays
from skinrender.film.camera import view_rays
from skinrender.scene.schema_camera import OrthographicCamera, PerspectiveCamera
from tests.volumes import Layer, slab_volume

SIZE = (2.0, 1.5)
PIXELS = (16, 12)
EDGES = np.array([0.0, 0.02, 0.1, 0.3])


def hills(depth_mm: float = 0.05, samples: int = 40) -> np.ndarray:
    """Control points of a smooth relief with slopes up to about 0.3."""
    x, y = (2.0 * np.pi * (np.arange(samples) + 0.5) / samples for _ in range(2))
    return depth_mm * np.sin(2.0 * x)[:, None] * np.cos(y)[None, :]


def lattice_of(camera, surface=None, sides: str = "periodic") -> RayLattice:
    volume = slab_volume([Layer(1.0, 0.1, 10.0)], size=SIZE, surface=surface, sides=sides)
    rays = view_rays(camera, SIZE)
    shape = rays.origin.shape[:2]
    plane = picture_plane(camera, volume, shape)
    return make_lattice(follow_rays(rays.origin, rays.direction, volume, EDGES), shape, plane)


CAMERAS = {
    "straight": OrthographicCamera(pixels=PIXELS),
    "aslant": OrthographicCamera(pixels=PIXELS, zenith_deg=50.0, azimuth_deg=25.0),
    "pinhole": PerspectiveCamera(kind="perspective", distance_mm=5.0, pixels=PIXELS),
    "pinhole aslant": PerspectiveCamera(
        kind="perspective", distance_mm=8.0, pixels=PIXELS, zenith_deg=35.0, window_mm=(1.2, 0.9)
    ),
    "detail": OrthographicCamera(pixels=PIXELS, window_mm=(0.4, 0.3), center_mm=(0.3, 1.2)),
}


def cells_of(lattice: RayLattice, slab: int, xy: np.ndarray) -> np.ndarray:
    """Bin of each point (n, 2) by the affine map alone; -1 outside."""
    h, w = lattice.shape
    m = lattice.to_lattice[slab]
    row, column = np.floor(xy @ m[:, :2].T + m[:, 2] + 0.5).astype(int).T
    return np.where((row >= 0) & (row < h) & (column >= 0) & (column < w), row * w + column, -1)


@pytest.mark.parametrize("name", ["straight", "aslant", "detail"])
def test_parallel_rays_on_a_flat_surface_have_a_bin_each(name):
    lattice = lattice_of(CAMERAS[name])
    w, h = PIXELS
    for slab in range(len(EDGES) - 1):
        assert np.array_equal(lattice.only_ray[slab], np.arange(h * w))
        assert np.array_equal(lattice.ray_of[slab], np.arange(h * w))
    assert np.allclose(lattice.bin_area, lattice.bin_area[0])


def test_bins_of_a_straight_view_are_the_pixels():
    lattice = lattice_of(CAMERAS["straight"])
    assert lattice.bin_area == pytest.approx(SIZE[0] * SIZE[1] / (PIXELS[0] * PIXELS[1]))
    assert lattice.bounds == pytest.approx(np.tile([0.0, 0.0, *SIZE], (len(EDGES) - 1, 1)), abs=1e-12)
    assert lattice.spacing_mm == pytest.approx(0.125)


def test_bins_of_an_oblique_view_are_stretched_pixels():
    lattice = lattice_of(CAMERAS["aslant"])
    assert lattice.bin_area == pytest.approx(0.125**2 / np.cos(np.radians(50.0)))


@pytest.mark.parametrize("surface", [None, hills()], ids=["flat", "relief"])
@pytest.mark.parametrize("name", CAMERAS)
def test_a_photon_finds_all_rays_of_its_bin_and_no_other(name, surface):
    lattice = lattice_of(CAMERAS[name], surface)
    h, w = lattice.shape
    rng = np.random.default_rng(3)
    for slab in range(len(EDGES) - 1):
        low, high = np.split(lattice.bounds[slab], 2)
        photons = rng.uniform(low - 0.1, high + 0.1, (500, 2))
        ray_cell = cells_of(lattice, slab, lattice.rays.point[slab])
        found_some = 0
        for (x, y), cell in zip(photons, cells_of(lattice, slab, photons)):
            assert bin_of(lattice.to_lattice, slab, x, y, h, w) == cell
            if cell < 0:
                continue
            found = lattice.ray_of[slab, lattice.bin_start[slab, cell] : lattice.bin_start[slab, cell + 1]]
            assert np.array_equal(np.sort(found), np.flatnonzero(ray_cell == cell))
            one = found[0] if len(found) == 1 else NO_RAY if len(found) == 0 else SEVERAL_RAYS
            assert lattice.only_ray[slab, cell] == one
            found_some += len(found) > 0
        assert found_some > 150


@pytest.mark.parametrize("name", CAMERAS)
def test_a_photon_on_a_ray_finds_it_on_a_relief(name):
    """But for rays that the relief bends over the lattice's edge, which are few."""
    lattice = lattice_of(CAMERAS[name], hills())
    for slab in range(len(EDGES) - 1):
        cell = cells_of(lattice, slab, lattice.rays.point[slab])
        start = lattice.bin_start[slab]
        for q in np.flatnonzero(cell >= 0):
            assert q in lattice.ray_of[slab, start[cell[q]] : start[cell[q] + 1]]
        assert np.mean(cell >= 0) > 0.9


@pytest.mark.parametrize("name", ["straight", "pinhole"])
def test_bins_per_ray_times_their_area_cover_the_picture(name):
    """What a photon adds to a ray is divided by the bin's area; on average over photons that must count each ray once."""
    lattice = lattice_of(CAMERAS[name], hills())
    for slab in range(len(EDGES) - 1):
        low, high = np.split(lattice.bounds[slab], 2)
        held = np.diff(lattice.bin_start[slab])
        assert held.sum() * lattice.bin_area[slab] == pytest.approx(np.prod(high - low), rel=0.1)


def test_rays_that_miss_the_patch_are_in_no_bin():
    camera = OrthographicCamera(pixels=PIXELS, window_mm=(4.0, 3.0))
    lattice = lattice_of(camera, sides="open")
    assert np.count_nonzero(lattice.rays.hit) == PIXELS[0] * PIXELS[1] // 4
    for slab in range(len(EDGES) - 1):
        held = lattice.ray_of[slab, : lattice.bin_start[slab, -1]]
        assert np.array_equal(np.sort(held), np.flatnonzero(lattice.rays.hit))


def test_a_view_of_the_sky_alone_is_empty():
    camera = OrthographicCamera(pixels=PIXELS, center_mm=(50.0, 50.0))
    lattice = lattice_of(camera, sides="open")
    assert not lattice.rays.hit.any()
    assert not lattice.bin_start[:, -1].any()


@pytest.mark.parametrize("pixels", [(1, 1), (1, 6), (5, 1)])
def test_bins_of_a_line_of_pixels_are_the_cameras(pixels):
    lattice = lattice_of(OrthographicCamera(pixels=pixels))
    area = SIZE[0] * SIZE[1] / (pixels[0] * pixels[1])
    assert np.allclose(lattice.bin_area, area)
    assert np.array_equal(lattice.only_ray[0], np.arange(pixels[0] * pixels[1]))
