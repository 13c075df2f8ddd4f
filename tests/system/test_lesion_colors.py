"""The lesions of the shipped scenes have the colors of the paper's section 8.2: brown above, blue-green below."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from skimage import io

from skinrender.engine.estimate import estimate
from skinrender.film.color import lab_of_factor
from skinrender.scene.load import load_scene
from skinrender.skin.builder import build_volume
from tests.walked_map import walk_map

CONFIGS = Path(__file__).parents[2] / "configs"
SEEDS = 6
HISTORIES = {"fig12_epidermal": 500, "fig13_papillary": 100, "fig14_deep": 600}
LARGEST_Z = 4.0


def region_factors(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean radiance factor of the lesion and its surround for each seed, (seeds, B) twice, and the wavelengths."""
    scene = load_scene(CONFIGS / f"{name}.yaml", ["bands_nm.step=20", "camera.pixels=[50,50]"])
    volume = build_volume(scene)
    darkness = 1.0 - io.imread(scene.path(scene.lesions[0].pattern)).astype(float) / 255.0
    darkness = darkness.reshape(50, 4, 50, 4).max(axis=(1, 3)), darkness.reshape(50, 4, 50, 4).min(axis=(1, 3))
    lesion, surround = darkness[1] > 0.5 * darkness[1].max(), darkness[0] == 0.0
    inside, outside = [], []
    for seed in range(1, SEEDS + 1):
        image, _ = estimate(scene, volume, walk_map(scene, volume, HISTORIES[name], seed=seed), progress=False)
        factor = image.radiance_factor()
        inside.append(factor[lesion].mean(axis=0, dtype=float))
        outside.append(factor[surround].mean(axis=0, dtype=float))
    return np.array(inside), np.array(outside), volume.wavelength_nm


def difference(inside: np.ndarray, outside: np.ndarray, wavelength_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lesion minus surround in L*, a*, b*, and its standard error over the seeds."""
    each = lab_of_factor(inside, wavelength_nm) - lab_of_factor(outside, wavelength_nm)
    return each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(len(each))


@pytest.fixture(scope="module")
def scenes():
    return {name: region_factors(name) for name in HISTORIES}


def red_to_blue(factor: np.ndarray, wavelength_nm: np.ndarray) -> tuple[float, float]:
    """R650 / R450 of the mean over the seeds, from the bands nearest to them, and its standard error."""
    red, blue = (factor[:, np.argmin(np.abs(wavelength_nm - nm))] for nm in (650.0, 450.0))
    each = red / blue
    return each.mean(), each.std(ddof=1) / np.sqrt(len(each))


def test_epidermal_macule_is_brown(scenes):
    mean, error = difference(*scenes["fig12_epidermal"])
    assert mean[0] + LARGEST_Z * error[0] < -5.0
    assert mean[2] - LARGEST_Z * error[2] > -1.0


def test_deep_macule_is_blue_green_against_its_surround(scenes):
    mean, error = difference(*scenes["fig14_deep"])
    assert mean[1] + LARGEST_Z * error[1] < -2.0
    assert mean[2] + LARGEST_Z * error[2] < -5.0


def test_red_to_blue_falls_with_the_depth_of_the_pigment(scenes):
    epidermal, e = red_to_blue(*scenes["fig12_epidermal"][::2])
    papillary, p = red_to_blue(*scenes["fig13_papillary"][::2])
    deep, d = red_to_blue(*scenes["fig14_deep"][::2])
    assert epidermal - deep > LARGEST_Z * np.hypot(e, d)
    assert papillary - deep > LARGEST_Z * np.hypot(p, d)
    assert epidermal > 2.0 > deep
