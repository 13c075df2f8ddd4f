"""Light under a relief keeps the pattern that the kernel would flatten, and noise is not taken for one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from skinrender.estimate.guide import Guides, color_patterns, modulations, patterns, restore
from skinrender.estimate.surface import entering_light
from skinrender.estimate.view_path import make_view_path
from skinrender.film.camera import view_rays
from skinrender.photonmap.light import light_from_scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from tests.maps import Lit, make_map, see, slab_data, slab_layer

SAMPLES, PIXELS = 40, 40
SPACING_MM = 1.0 / PIXELS
X = np.arange(SAMPLES) / SAMPLES
LAMP = {"kind": "collimated", "zenith_deg": 50.0}


def kernel(picture: np.ndarray) -> np.ndarray:
    """A filter as wide as the widest kernel."""
    return gaussian_filter(picture, 0.14 / SPACING_MM, mode="wrap")


def furrow(folder, depth_um: float, light: dict, size_mm: float = 1.0) -> tuple:
    """Scene and volume of one furrow along y in a periodic slab."""
    profile = -depth_um * np.exp(-0.5 * ((X - 0.5) / 0.06) ** 2)
    np.save(folder / "furrow.npy", np.tile(profile, (SAMPLES, 1)))
    data = slab_data([slab_layer(0.6, 2.0, 20.0, 0.7, 1.4)], light, size_mm, PIXELS)
    relief = {"kind": "height_map", "file": "furrow.npy", "um_per_unit": 1.0}
    scene = make_scene({**data, "patch": {"size_mm": [size_mm, size_mm], "columns": [40, 40]}, "relief": relief}, source_dir=folder)
    return scene, build_volume(scene)


def waves() -> tuple[np.ndarray, np.ndarray]:
    """A guide of mean 1 and a height, across each other."""
    light = np.broadcast_to(1.0 + 0.5 * np.sin(4 * math.pi * X), (PIXELS, PIXELS))
    return light, 0.03 * light.T


def test_a_pattern_that_the_kernel_flattens_is_restored():
    light, height = waves()
    guides = patterns([light], height, SPACING_MM, wrap=True)
    truth = 2.0 + (light - 1.0) + 10.0 * height
    flat = kernel(truth)
    found = flat * restore(flat, truth, modulations(guides, kernel)).factor
    assert np.ptp(flat / truth) > 0.3
    assert np.abs(found / truth - 1.0).max() < 0.03


def test_noise_moves_no_mean():
    light, height = waves()
    changes = modulations(patterns([light], height, SPACING_MM, wrap=True), kernel)
    rng, truth = np.random.default_rng(1), 2.0 + 0.5 * (light - 1.0)
    exact = restore(kernel(truth), truth, changes).factor
    factors = []
    for _ in range(100):
        noisy = rng.poisson(3.0 * truth) / 3.0
        factors.append(restore(kernel(noisy), noisy, changes).factor)
    error = np.std(factors, axis=0, ddof=1) / 10.0
    z = (np.mean(factors, axis=0) - exact) / error
    assert abs(z).max() < 5.5
    assert error.max() < 0.01


def test_noise_of_the_fit_is_in_the_batches():
    """Pictures made of 20 batches each scatter as their batches do, although all share one fit."""
    light, height = waves()
    changes = modulations(patterns([light], height, SPACING_MM, wrap=True), kernel)
    rng, truth = np.random.default_rng(2), 2.0 + 0.5 * (light - 1.0)
    shown, claimed = [], []
    for _ in range(150):
        noisy = rng.poisson(3.0 * truth, (20, PIXELS, PIXELS)) / 3.0
        plain = np.array([kernel(one) for one in noisy])
        restoration = restore(plain.mean(axis=0), noisy.mean(axis=0), changes)
        shown.append(restoration.plain * restoration.factor)
        batches = np.array([restoration.batch(*pair) for pair in zip(plain, noisy)])
        assert batches.mean(axis=0) == pytest.approx(shown[-1], rel=1e-9)
        claimed.append(batches.var(axis=0, ddof=1) / 20)
    assert np.var(shown, axis=0, ddof=1).mean() == pytest.approx(np.mean(claimed), rel=0.1)


def test_without_a_pattern_only_the_mean_is_kept():
    flat = np.zeros((PIXELS, PIXELS))
    changes = modulations(patterns([], flat, SPACING_MM, wrap=True), kernel)
    assert restore(flat + 1.0, flat + 1.5, changes).factor == pytest.approx(flat + 1.5)
    changes = modulations(patterns([waves()[0]], waves()[1], SPACING_MM, wrap=True), kernel)
    assert np.array_equal(restore(flat, flat, changes).factor, flat + 1.0)


LESION_PIXELS, LESION_SPACING_MM = 100, 0.05


def color_kernel(picture: np.ndarray) -> np.ndarray:
    """A filter as wide as that of the spectra's shape."""
    return gaussian_filter(picture, 0.42 / LESION_SPACING_MM, mode="wrap")


def spots() -> np.ndarray:
    """Absorbance of a lesion of uneven spots, one column a pixel."""
    rng = np.random.default_rng(3)
    x = (np.arange(LESION_PIXELS) + 0.5) * LESION_SPACING_MM
    inside = (x[:, None] - 2.5) ** 2 + (x[None, :] - 2.5) ** 2 < 1.5**2
    return np.where(inside, rng.uniform(0.2, 1.0, inside.shape), 0.0)


def of_lesion(absorbance: np.ndarray) -> np.ndarray:
    """What restores the color of a lesion on a flat surface."""
    color = color_patterns([np.exp(-absorbance)], LESION_SPACING_MM, wrap=True)
    return Guides([], [], color, []).of_color(color_kernel)


@pytest.mark.parametrize("strength", [0.3, 0.7, 1.1])
def test_color_of_a_lesion_is_restored_whatever_a_band_sees_of_it(strength):
    absorbance = spots()
    truth = gaussian_filter(np.exp(-strength * absorbance), 0.06 / LESION_SPACING_MM, mode="wrap")
    flat = color_kernel(truth)
    found = flat * restore(flat, truth, of_lesion(absorbance)).factor
    off, inside = found / truth - 1.0, absorbance > 0.0
    assert np.abs(flat / truth - 1.0).max() > 0.1
    assert np.abs(off).max() < 0.06 and np.sqrt((off * off).mean()) < 0.01
    assert found[inside].mean() == pytest.approx(truth[inside].mean(), rel=1e-3)


def test_noise_moves_no_color():
    absorbance = spots()
    changes = of_lesion(absorbance)
    rng, truth = np.random.default_rng(4), np.exp(-0.7 * absorbance)
    exact = restore(color_kernel(truth), truth, changes).factor
    factors = []
    for _ in range(60):
        noisy = rng.poisson(3.0 * truth) / 3.0
        factors.append(restore(color_kernel(noisy), noisy, changes).factor)
    error = np.std(factors, axis=0, ddof=1) / math.sqrt(len(factors))
    z = (np.mean(factors, axis=0) - exact) / error
    assert abs(z).max() < 5.5
    assert error.max() < 0.01


def test_light_that_enters_a_relief(tmp_path):
    """All of it comes from the lamp: the mean is the flat surface's but for Fresnel's reflection; the far wall is darker."""
    scene, volume = furrow(tmp_path, 60.0, LAMP)
    rays = view_rays(scene.camera, volume.size_mm)
    path = make_view_path(rays.origin, rays.direction, volume)
    light = light_from_scene(scene)
    seen = entering_light(path.entry, path.hit, volume, light).reshape(PIXELS, PIXELS)
    across = light.irradiance.sum() * math.cos(math.radians(50.0))
    assert 0.9 * across < seen.mean() < across
    profile = seen.mean(axis=0)
    assert seen == pytest.approx(np.tile(profile, (PIXELS, 1)), rel=1e-3)
    assert profile.max() > 1.3 * profile[0]
    assert profile.min() < 0.7 * profile[0]


def walls(folder, depth_um: float, histories: int, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """Brightness of a furrow's walls, in parts 0.1 mm wide, over the picture's: by beam and by the reference, (seeds, 6)."""
    scene, volume = furrow(folder, depth_um, LAMP)
    found = []
    for seed in range(1, seeds + 1):
        lit = Lit(scene, volume, make_map(volume, light_from_scene(scene), histories, seed=seed))
        pictures = [see(lit, method)[0].y() for method in ("beam", "reference")]
        profiles = [y.mean(axis=0)[8:32].reshape(6, 4).mean(axis=1) / y.mean() for y in pictures]
        found.append(profiles)
    return np.swapaxes(found, 0, 1)


def test_walls_of_a_furrow_keep_their_shading(tmp_path):
    beam, exact = walls(tmp_path, 60.0, 500, 5)
    error = np.std(beam - exact, axis=0, ddof=1) / math.sqrt(len(beam))
    off = (beam - exact).mean(axis=0)
    assert np.ptp(exact.mean(axis=0)) > 0.2
    assert np.abs(off / error).max() < 7.0  # Student's t of 4 degrees of freedom, six values
    assert error.max() < 0.04
    assert np.abs(off).max() < 0.06


@pytest.mark.slow
def test_walls_of_a_furrow_keep_their_shading_to_three_percent(tmp_path):
    beam, exact = walls(tmp_path, 60.0, 2600, 8)
    error = np.std(beam - exact, axis=0, ddof=1) / math.sqrt(len(beam))
    off = (beam - exact).mean(axis=0)
    assert error.max() < 0.01
    assert np.abs(off / exact.mean(axis=0)).max() < 0.03
