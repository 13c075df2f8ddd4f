"""Point and beam estimate of independent photons, and the reference, agree, in skin and in slabs, flat and with
relief."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from skinrender.photonmap.light import light_from_scene
from tests.maps import Lit, light_up, make_map, see, slab_data, slab_layer
from tests.stats import assert_same_means

LARGEST_Z = 4.0
STACK = [slab_layer(0.08, 2.0, 30.0, 0.8, 1.4), slab_layer(2.0, 0.2, 12.0, 0.75, 1.4)]
SKIN = {
    "patch": {"size_mm": [2, 2], "columns": [80, 80]},
    "bands_nm": [450, 550, 650],
    "skin": {"site": "forearm"},
    "light": {"kind": "collimated", "spectrum": "E"},
    "camera": {"pixels": [16, 16], "cross_polarized": True},
}
SKY = {"kind": "sky", "spectrum": "E"}
LAMP = {"kind": "point", "height_mm": 20, "spectrum": "E"}
FURROWS = {"kind": "procedural", "families": [{"angle_deg": 30, "spacing_mm": 0.5, "depth_um": 40, "width_um": 120}]}
SCENES = {
    "slab": ({**slab_data(STACK, {"kind": "collimated"}, 2.0, 16), "inner_borders": "matched"}, {}, 2000),
    "slab under a lamp": ({**slab_data(STACK, LAMP, 2.0, 16), "sides": "dielectric"}, {}, 3500),
    "slab with furrows": (
        {**slab_data(STACK, SKY, 2.0, 16), "inner_borders": "matched", "relief": FURROWS}, {"zenith_deg": 40}, 3000
    ),
    "flat skin": ({**SKIN, "relief": {"kind": "flat"}}, {}, 700),
    "skin": (SKIN, {}, 500),
    "skin aslant": (SKIN, {"zenith_deg": 50, "azimuth_deg": 70}, 800),
}  # fmt: skip


class Seen(NamedTuple):
    """Mean radiance with its error, and radiance by seed (seeds, B)."""

    mean: float
    stderr: float
    bands: np.ndarray


def seen(lit: Lit, method: str, camera: dict, histories: int, seeds: range) -> Seen:
    light = light_from_scene(lit.scene)
    pictures = [
        see(lit._replace(photons=make_map(lit.volume, light, histories, seed=seed)), method, camera) for seed in seeds
    ]
    summaries = [summary for _, summary in pictures]
    return Seen(
        float(np.mean([summary.mean_radiance for summary in summaries])),
        float(np.linalg.norm([summary.mean_radiance_stderr for summary in summaries]) / len(seeds)),
        np.array([image.radiance.mean(axis=(0, 1), dtype=float) for image, _ in pictures]),
    )


@pytest.mark.parametrize("name", SCENES)
def test_point_and_beam_show_the_same_light(name):
    data, camera, histories = SCENES[name]
    lit = light_up(data, 1, rounds=1)
    beam = seen(lit, "beam", camera, histories, range(1, 5))
    point = seen(lit, "point", camera, histories, range(5, 9))
    error = np.hypot(beam.stderr, point.stderr)
    assert abs(point.mean - beam.mean) < LARGEST_Z * error
    assert error < 0.01 * beam.mean
    assert_same_means(beam.bands, point.bands)


RELIEF = [pytest.param(name, marks=pytest.mark.slow) for name in ("skin", "skin aslant")]


@pytest.mark.parametrize("name", ["slab", "slab under a lamp", "slab with furrows", *RELIEF])
def test_beam_shows_what_the_reference_shows(name):
    data, camera, histories = SCENES[name]
    lit = light_up(data, 1, rounds=1)
    beam = seen(lit, "beam", camera, 2 * histories, range(1, 3))
    exact = seen(lit, "reference", camera, 2 * histories, range(1, 3))
    assert abs(beam.mean - exact.mean) < 3.0 * exact.stderr
    assert exact.stderr < 0.012 * exact.mean


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_point_and_beam_show_the_same_light_more_closely(name):
    data, camera, histories = SCENES[name]
    lit = light_up(data, 1, rounds=1)
    beam = seen(lit, "beam", camera, 5 * histories, range(1, 7))
    point = seen(lit, "point", camera, 5 * histories, range(7, 13))
    error = np.hypot(beam.stderr, point.stderr)
    assert abs(point.mean - beam.mean) < LARGEST_Z * error
    assert error < 0.004 * beam.mean
    assert_same_means(beam.bands, point.bands)
