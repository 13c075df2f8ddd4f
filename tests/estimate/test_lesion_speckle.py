"""Colors inside a lesion: what the wide kernel of the spectra's shape flattens is restored, and noise is not kept for it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image

from skinrender.photonmap.light import light_from_scene
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from tests.maps import Lit, make_map, see

PIXELS, SEEDS = 40, 6
BANDS_NM = [450, 550, 650]
STUDENT_T = 12.0
"""Of 5 degrees of freedom, once in 14000; 9 values are looked at."""


def spots() -> np.ndarray:
    """Darkness of each pixel: a disk of uneven spots, (h, w)."""
    x = np.arange(PIXELS) + 0.5 - PIXELS / 2
    inside = x[:, None] ** 2 + x[None, :] ** 2 < (0.3 * PIXELS) ** 2
    return np.where(inside, np.random.default_rng(5).uniform(0.3, 1.0, inside.shape), 0.0)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Radiance of one macule by beam with two kernels, with one, and by the reference: (3, seeds, h, w, B); darkness."""
    folder, darkness = tmp_path_factory.mktemp("speckle"), spots()
    Image.fromarray((255 * (1.0 - darkness)).astype(np.uint8)).save(folder / "spots.png")
    scene = make_scene(
        {
            "patch": {"size_mm": [4, 4], "columns": [PIXELS, PIXELS]}, "bands_nm": BANDS_NM,
            "skin": {"border_wave": {"peak_to_valley_um": 0}}, "relief": {"kind": "flat"},
            "lesions": [{"kind": "epidermal", "pattern": "spots.png", "melanin_scale": 0.3}],
            "light": {"kind": "collimated", "spectrum": "E"},
            "camera": {"pixels": [PIXELS, PIXELS], "cross_polarized": True},
        },
        source_dir=folder,
    )  # fmt: skip
    volume, light = build_volume(scene), light_from_scene(scene)
    found = []
    for seed in range(1, SEEDS + 1):
        lit = Lit(scene, volume, make_map(volume, light, 500, seed=seed))
        seen = (see(lit), see(lit, gather_count=10**9), see(lit, "reference"))
        found.append([picture.radiance.astype(float) for picture, _ in seen])
    return np.swapaxes(found, 0, 1), darkness


def test_spectra_of_dark_and_light_spots_are_those_of_the_reference(pictures):
    """Edges too: the mean of each band over spots, over what is between them, and over the skin around."""
    (found, _, exact), darkness = pictures
    middle = np.median(darkness[darkness > 0.0])
    regions = (darkness > middle, (darkness > 0.0) & (darkness <= middle), darkness == 0.0)
    of_region = [[picture[:, region].mean(axis=1) for region in regions] for picture in (found, exact)]
    (found, exact), off = of_region, np.subtract(*of_region)
    error = off.std(axis=1, ddof=1) / math.sqrt(SEEDS)
    relative = np.abs(off.mean(axis=1)) / np.mean(exact, axis=1)
    assert np.abs(off.mean(axis=1) / error).max() < STUDENT_T
    assert relative.max() < 0.03


def test_color_inside_a_lesion_has_less_noise_than_with_one_kernel(pictures):
    (two, one, _), darkness = pictures
    inside = darkness > 0.0

    def noise(found: np.ndarray) -> float:
        shape = found / found.mean(axis=3, keepdims=True)
        return (shape.std(axis=0, ddof=1) / shape.mean(axis=0))[inside].mean()

    assert noise(two) < 0.4 * noise(one)
