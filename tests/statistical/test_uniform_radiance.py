"""Pixel radiance of uniform slabs against adding-doubling: the whole way from the lamp to the film."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from skinrender.engine.estimate import estimate
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from tests.walked_map import walk_map

TRUTH = json.loads((Path(__file__).parents[1] / "truth" / "slab_fields.json").read_text())
RECORDS = {record["id"]: record for record in TRUTH["records"]}
LARGEST_Z = 4.0
CASES = [
    ("vdh-slab/normal", 1.0, 20000),
    ("vdh-slab/normal", 0.5, 20000),
    ("vdh-slab/diffuse", 0.9, 20000),
    ("pub1/normal", 1.0, 3000),
    ("pub1/diffuse", 0.5, 3000),
    ("pub2/normal", 0.9, 9000),
    ("pub3/normal", 1.0, 3000),
    ("pub3/diffuse", 0.6, 3000),
]


def uniform_scene(record: dict, mu: float):
    """The record's slab under a unit irradiance, seen by parallel rays at the outside cosine mu."""
    normal = {"kind": "collimated", "irradiance_W_per_mm2": 1.0, "spectrum": "E"}
    sky = {"kind": "sky", "radiance_W_per_mm2_sr": 1.0 / math.pi, "spectrum": "E"}
    return make_scene(
        {
            "patch": {"size_mm": [2.0, 2.0], "columns": [1, 1]},
            "bands_nm": [550],
            "slab": {
                "layers": [
                    {
                        "thickness_mm": layer["thickness_mm"],
                        "mu_a_per_mm": layer["mu_a"],
                        "mu_s_per_mm": layer["mu_s"],
                        "g": layer["g"],
                        "refractive_index": layer["n"],
                    }
                    for layer in record["layers"]
                ]
            },
            "inner_borders": "fresnel",
            "below": {"refractive_index": 1.0},
            "light": normal if record["id"].endswith("normal") else sky,
            "camera": {
                "pixels": [8, 8],
                "zenith_deg": math.degrees(math.acos(mu)),
                "cross_polarized": True,
            },
        }
    )


@pytest.mark.parametrize("method", ["beam", "point"])
@pytest.mark.parametrize(("name", "mu", "histories"), CASES)
def test_radiance_of_a_uniform_slab(name, mu, histories, method):
    record = RECORDS[name]
    scene = uniform_scene(record, mu)
    volume = build_volume(scene)
    photon_map = walk_map(scene, volume, histories, seed=CASES.index((name, mu, histories)) + 1)
    _, summary = estimate(scene, volume, photon_map, method=method, progress=False)
    expected = record["exit_radiance_top"][record["exit_mu"].index(mu)]
    assert summary.mean_radiance_stderr < 0.02 * expected
    z = (summary.mean_radiance - expected) / summary.mean_radiance_stderr
    assert abs(z) < LARGEST_Z
