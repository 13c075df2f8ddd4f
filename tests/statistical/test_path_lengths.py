"""Paths without absorption, by which the tones are fitted, beside the photon walk."""

from __future__ import annotations

import numpy as np
from scipy import stats

import skinrender
from benchmarks.path_lengths import volume_paths
from skinrender.scene import make_scene
from skinrender.skin.builder import build_volume
from tests.stats import threshold

NM = [400, 500, 550, 600, 700]
BATCHES, PHOTONS = 16, 2000


def test_absorption_laid_on_paths_gives_the_reflectance_of_the_walk():
    scene = make_scene(
        {"patch": {"size_mm": [4, 4], "columns": [1, 1]}, "bands_nm": NM, "relief": {"kind": "flat"},
         "skin": {"tone": "tan", "border_wave": {"peak_to_valley_um": 0}}}
    )  # fmt: skip
    volume = build_volume(scene)
    mu_a = np.stack([volume.mu_a[volume.palette_layer == layer][0] for layer in range(1, len(volume.layer_name))])
    laid_on = np.array(
        [
            [paths.reflectance(mu_a[:, band]) for band, paths in enumerate(volume_paths(volume, PHOTONS, seed))]
            for seed in range(BATCHES)
        ]
    )
    walked = skinrender.spectrum(scene, stderr=0.01, workers=1).patch
    error = np.hypot(laid_on.std(axis=0, ddof=1) / np.sqrt(BATCHES), walked.total_stderr)
    p = 2.0 * stats.t.sf(np.abs(laid_on.mean(axis=0) - walked.total) / error, BATCHES - 1)
    assert p.min() > threshold(len(NM)), p
