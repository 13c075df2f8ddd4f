"""One connection per photon: slab images against plain sums over the photons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from skinrender.estimate.kernel_filter import gaussian
from skinrender.estimate.radius import WIDEST_MM
from skinrender.estimate.ray_paths import visible_depth_mm
from skinrender.film.camera import view_rays
from tests.direct_sum import henyey_greenstein, photons_of, rays_of
from tests.maps import W_PER_MM2, Lit, light_up, make_map, see, slab_data, slab_layer
from tests.volumes import beam

PIXELS, SIZE_MM, N = 16, 2.0, 1.4
LAYER = slab_layer(0.6, 0.5, 12.0, 0.7, N)


@pytest.fixture(scope="module")
def lit() -> Lit:
    return light_up(slab_data([LAYER], {"kind": "collimated"}, SIZE_MM, PIXELS), 1000)


def multiple(lit: Lit, **options) -> np.ndarray:
    """Multiply scattered light of the picture by beams, W mm^-2 sr^-1."""
    return see(lit, "beam", **options)[0].multiple_Y.astype(float) * W_PER_MM2


def in_pixels(lit: Lit) -> np.ndarray:
    """What photons send straight up, divided by the area of the pixel below which they are."""
    photons = photons_of(lit.photons, visible_depth_mm(lit.volume))
    mu_t = float(lit.volume.mu_a[1, 0] + lit.volume.mu_s[1, 0])
    rays = view_rays(lit.scene.camera, lit.volume.size_mm)
    outside = rays_of(rays.origin, rays.direction, N).transmission[0]
    value = photons.power * np.exp(-mu_t * photons.position[:, 2])
    value *= outside * henyey_greenstein(-photons.direction[:, 2], lit.volume.g[1, 0])
    pixel = np.floor(photons.position[:, :2] / (SIZE_MM / PIXELS)).astype(int)
    image = np.zeros((PIXELS, PIXELS))
    np.add.at(image, (pixel[:, 1], pixel[:, 0]), value)
    return image / (SIZE_MM / PIXELS) ** 2


def filtered(image: np.ndarray, radius_mm: float) -> np.ndarray:
    weights = gaussian(radius_mm / (SIZE_MM / PIXELS)).astype(float)
    return ndimage.correlate1d(ndimage.correlate1d(image, weights, axis=0, mode="wrap"), weights, axis=1, mode="wrap")


def test_straight_view_of_a_slab_is_the_sum_over_its_photons(lit):
    assert multiple(lit) == pytest.approx(filtered(in_pixels(lit), WIDEST_MM), rel=2e-4)


def test_weights_of_roulette_are_counted(lit):
    photons = replace(lit.photons, keep_probability=np.full_like(lit.photons.keep_probability, 0.5))
    assert multiple(Lit(lit.scene, lit.volume, photons)) == pytest.approx(
        filtered(in_pixels(Lit(lit.scene, lit.volume, photons)), WIDEST_MM), rel=2e-4
    )
    whole = replace(lit.photons, keep_probability=None, depth_edges_mm=None)
    assert multiple(Lit(lit.scene, lit.volume, whole)) == pytest.approx(
        0.5 * multiple(Lit(lit.scene, lit.volume, photons)), rel=1e-4
    )


def test_a_relief_of_no_height_is_flat(lit):
    """It takes other paths through the code: depth below the relief, several rays a pixel."""
    flat = replace(lit.volume, surface_mm=np.zeros((8, 8), np.float32))
    assert multiple(Lit(lit.scene, flat, lit.photons)) == pytest.approx(multiple(lit), rel=2e-3)


def test_finely_cut_volume_looks_the_same(lit):
    """Rays then cross many voxels, and g is read from them."""
    index = np.ones((20, 20, 30), np.uint16)
    index[::2, ::3, ::2] = 2
    cut = replace(
        lit.volume, palette_index=index, z_edges_mm=np.linspace(0.0, 0.6, 31), palette_layer=np.array([0, 1, 1], np.uint8),
        palette_melanin=np.array([0.0, 0.0, 0.1], np.float32), mu_a=lit.volume.mu_a[[0, 1, 1]],
        mu_s=lit.volume.mu_s[[0, 1, 1]], g=lit.volume.g[[0, 1, 1]] + np.array([[0.0], [0.0], [1e-12]]),
    )  # fmt: skip
    assert multiple(Lit(lit.scene, cut, lit.photons)) == pytest.approx(multiple(lit), rel=1e-4)


def test_threads_do_not_matter(lit):
    assert multiple(lit, threads=1) == pytest.approx(multiple(lit, threads=3), rel=1e-5)


def test_a_window_of_many_tiles_sees_each_tile(lit):
    """3 x 3 tiles at the same distance of rays."""
    wide = {"window_mm": (3 * SIZE_MM, 3 * SIZE_MM), "pixels": (3 * PIXELS, 3 * PIXELS)}
    tiles = multiple(lit, camera=wide).reshape(3, PIXELS, 3, PIXELS).transpose(0, 2, 1, 3)
    assert tiles[1, 1] == pytest.approx(multiple(lit), rel=1e-4)


def test_a_window_of_very_many_tiles_loses_none(lit):
    tiny = light_up(slab_data([LAYER], {"kind": "collimated"}, 0.1, 4), 200)
    window = {"window_mm": (2.0, 2.0), "pixels": (4, 4)}
    assert multiple(tiny, camera=window).mean() == pytest.approx(multiple(tiny).mean(), rel=0.02)


def test_a_detail_is_cut_out_of_the_whole(lit):
    """Inside, a kernel's width from the detail's border."""
    half = {"window_mm": (0.5 * SIZE_MM, 0.5 * SIZE_MM), "pixels": (PIXELS // 2, PIXELS // 2)}
    detail, quarter = multiple(lit, camera=half), PIXELS // 4
    whole = multiple(lit)[quarter:-quarter, quarter:-quarter]
    assert detail[3:-3, 3:-3] == pytest.approx(whole[3:-3, 3:-3], rel=0.01)


@pytest.mark.parametrize("method", ["beam", "point"])
def test_clear_slab_is_dark(method):
    data = slab_data([{**LAYER, "mu_s_per_mm": 0.0}], {"kind": "collimated"}, SIZE_MM, 4)
    image, summary = see(light_up(data, 20), method)
    assert not image.radiance.any()
    assert summary.nan_pixels == 0 and summary.mean_radiance == 0.0 and summary.photons_gathered == 0.0


@pytest.mark.parametrize("method", ["beam", "point"])
@pytest.mark.parametrize("gather_count", [1, 10**9, None])
def test_all_photons_at_one_place(lit, method, gather_count):
    photons = replace(lit.photons, position=np.broadcast_to(np.float32([1.0, 1.0, 0.05]), lit.photons.position.shape))
    image, summary = see(Lit(lit.scene, lit.volume, photons), method, gather_count=gather_count)
    assert np.isfinite(image.radiance).all() and np.isfinite(image.stderr_Y).all()
    assert image.radiance.min() >= 0.0 and image.multiple_Y.max() > 0.0


@pytest.mark.parametrize("zenith_deg", [0.0, 60.0, 89.0])
@pytest.mark.parametrize("mu_s", [1e-3, 1e4])
def test_extreme_slabs_and_views_stay_finite(zenith_deg, mu_s):
    data = slab_data([{**LAYER, "mu_s_per_mm": mu_s}], {"kind": "collimated"}, SIZE_MM, 4)
    image, _ = see(light_up(data, 50 if mu_s < 1.0 else 1), camera={"zenith_deg": zenith_deg})
    assert np.isfinite(image.radiance).all() and image.radiance.min() >= 0.0


def test_single_scattering_left_out_is_stored():
    """A pencil has no term of its own, its first scatterings are photons: together they are a wide beam's light."""
    wide = light_up(slab_data([LAYER], {"kind": "collimated"}, SIZE_MM, 4), 2000)
    narrow = light_up(
        slab_data([LAYER], {"kind": "collimated", "radius_mm": 0, "power_W": SIZE_MM**2}, SIZE_MM, 4), 2000, seed=2
    )
    (_, a), (image, b) = see(wide), see(narrow)
    assert not image.single_Y.any()
    assert abs(a.mean_radiance - b.mean_radiance) < 4.0 * np.hypot(a.mean_radiance_stderr, b.mean_radiance_stderr)
    assert b.mean_radiance_stderr < 0.03 * b.mean_radiance


def test_walk_is_seen_from_its_own_volume(lit):
    """The power of a photon follows from the map alone: twice the histories, the same light."""
    more = make_map(lit.volume, beam(), 2000, seed=5)
    (_, a), (_, b) = see(lit), see(Lit(lit.scene, lit.volume, more))
    assert abs(a.mean_radiance - b.mean_radiance) < 4.0 * np.hypot(a.mean_radiance_stderr, b.mean_radiance_stderr)
