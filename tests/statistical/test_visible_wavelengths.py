"""More histories where the eye looks change the noise of a picture, not the picture."""

from __future__ import annotations

import numpy as np
import pytest

from skinrender.engine.estimate import estimate
from skinrender.engine.trace import trace
from skinrender.photonmap.photon_map import open_map
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import save_volume

LARGEST_Z = 4.0
SEEDS = 4


def slab(wavelengths: str, seed: int):
    layer = {"thickness_mm": 0.5, "mu_a_per_mm": 0.5, "mu_s_per_mm": 20, "g": 0.8, "refractive_index": 1.4}
    return make_scene(
        {
            "patch": {"size_mm": [1, 1], "columns": [1, 1]},
            "bands_nm": {"start": 400, "stop": 700, "step": 50},
            "slab": {"layers": [layer]},
            "light": {"kind": "sky", "radiance_W_per_mm2_sr": 1.0, "spectrum": "E"},
            "camera": {"pixels": [6, 6], "cross_polarized": True},
            "photons": {"stored": 1_000_000, "seed": seed, "wavelengths": wavelengths},
        }
    )


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Mean radiance of each band (SEEDS, B) and histories of each band, both ways."""
    folder = tmp_path_factory.mktemp("visible")
    volume = build_volume(slab("uniform", 1))
    save_volume(volume, folder / "volume.npz")
    told = {}
    for k, wavelengths in enumerate(("uniform", "visible")):
        means, emitted = [], []
        for seed in range(1, SEEDS + 1):
            scene = slab(wavelengths, 10 * k + seed)
            trace(scene, folder / "volume.npz", folder, workers=1, progress=False)
            photon_map = open_map(folder / "photons.npz")
            means.append(estimate(scene, volume, photon_map, progress=False)[0].radiance.mean(axis=(0, 1)))
            emitted.append(photon_map.emitted_per_band)
        told[wavelengths] = np.array(means), np.mean(emitted, axis=0)
    return told


def test_bands_by_which_a_picture_has_its_color_get_more_histories(pictures):
    emitted = pictures["visible"][1]
    assert np.ptp(pictures["uniform"][1]) == 0
    assert emitted[1] > 2 * emitted[0] and emitted[4] > 2 * emitted[6], "450 over 400 nm, 600 over 700 nm"


def test_radiance_is_the_same(pictures):
    """All bands of this slab have the same radiance, and an error that goes with the root of their histories."""
    (uniform, _), (visible, emitted) = pictures["uniform"], pictures["visible"]
    bands = len(emitted)
    scaled = (visible - visible.mean(axis=0)) * np.sqrt(emitted)
    spread = np.sqrt((scaled**2).sum() / (scaled.size - bands))
    error = np.hypot(spread / np.sqrt(SEEDS * emitted), uniform.std(ddof=1) / np.sqrt(uniform.size))
    assert np.all(np.abs(visible.mean(axis=0) - uniform.mean()) < LARGEST_Z * error)
    assert error.max() < 0.02 * uniform.mean()
