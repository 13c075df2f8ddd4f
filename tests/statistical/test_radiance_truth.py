"""Radiance of layered slabs against truth: flat, laterally uniform and uniformly lit, every pixel shows one number."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from tests.maps import W_PER_MM2, Lit, light_up, see, slab_data, slab_layer

TRUTH = Path(__file__).parents[1] / "truth" / "slab_fields.json"
RECORDS = {record["id"]: record for record in json.loads(TRUTH.read_text(encoding="utf-8"))["records"]}
VIEWS = (1.0, 0.9, 0.5)
LARGEST_Z = 4.0
ROUNDS = 40
HISTORIES = {
    "vdh-slab/normal": 36_000, "vdh-slab/diffuse": 30_000, "pub1/normal": 4_500, "pub1/diffuse": 4_500,
    "pub2/normal": 84_000, "pub2/diffuse": 66_000, "pub3/normal": 11_000, "pub3/diffuse": 11_000,
}  # fmt: skip
"""Of a round; they bring the standard error to about 0.4 %."""
MORE_HISTORIES = {
    "vdh-slab/normal": 220_000, "vdh-slab/diffuse": 100_000, "pub1/normal": 26_000, "pub1/diffuse": 38_000,
    "pub2/normal": 270_000, "pub2/diffuse": 220_000, "pub3/normal": 55_000, "pub3/diffuse": 100_000,
}  # fmt: skip
"""For about 0.22 %."""
WANTED, WANTED_SLOW = 0.006, 0.003
"""Largest relative standard errors. They are estimated from 20 batches, so that they scatter by 16 % themselves."""
NARROWEST = 1
"""Photons wanted in a sphere for which it is as narrow as may be, and looks at the fewest photons."""


class Slab(NamedTuple):
    """A record of truth with a walked map of its slab."""

    record: dict
    lit: Lit


class Seen(NamedTuple):
    """Mean radiance of a view over truth's."""

    ratio: float
    stderr: float

    @property
    def z(self) -> float:
        return (self.ratio - 1.0) / self.stderr


def data_of(record: dict) -> dict:
    sky = {"kind": "sky", "radiance_W_per_mm2_sr": 1.0 / math.pi}
    light = sky if record["incidence"] == "diffuse" else {"kind": "collimated"}
    layers = [slab_layer(*(layer[key] for key in ("thickness_mm", "mu_a", "mu_s", "g", "n"))) for layer in record["layers"]]
    assert record["n_above"] == 1.0 and record["n_below"] == 1.0
    return slab_data(layers, light)


def walked(name: str, histories: int, seed: int) -> Slab:
    record = RECORDS[name]
    return Slab(record, light_up(data_of(record), histories, ROUNDS, seed))


def view(slab: Slab, mu: float, method: str, gather_count: int | None = None) -> Seen:
    camera = {"zenith_deg": math.degrees(math.acos(mu))}
    _, summary = see(slab.lit, method, camera, gather_count=gather_count)
    truth = slab.record["exit_radiance_top"][slab.record["exit_mu"].index(mu)]
    return Seen(summary.mean_radiance / truth, summary.mean_radiance_stderr / truth)


@pytest.fixture(scope="module", params=HISTORIES)
def slab(request) -> Slab:
    return walked(request.param, HISTORIES[request.param], seed=1)


@pytest.fixture(scope="module", params=HISTORIES)
def fine_slab(request) -> Slab:
    return walked(request.param, MORE_HISTORIES[request.param], seed=2)


@pytest.mark.parametrize("mu", VIEWS)
def test_beam_estimate_shows_the_radiance_of_a_slab(slab, mu):
    seen = view(slab, mu, "beam")
    assert abs(seen.z) < LARGEST_Z, seen
    assert seen.stderr < WANTED


def test_point_estimate_shows_the_radiance_of_a_slab(slab):
    seen = view(slab, 1.0, "point", NARROWEST)
    assert abs(seen.z) < LARGEST_Z, seen
    assert seen.stderr < WANTED


@pytest.mark.slow
def test_point_estimate_with_its_widest_spheres(slab):
    seen = view(slab, 1.0, "point")
    assert abs(seen.z) < LARGEST_Z, seen
    assert seen.stderr < WANTED


@pytest.mark.parametrize("mu", VIEWS)
def test_reference_shows_the_radiance_of_a_slab(slab, mu):
    seen = view(slab, mu, "reference")
    assert abs(seen.z) < LARGEST_Z, seen
    assert seen.stderr < WANTED


def test_parts_add_up(slab):
    image, summary = see(slab.lit)
    assert not image.surface_Y.any()
    assert np.allclose(image.single_Y + image.multiple_Y, image.y(), rtol=1e-5)
    assert image.y().mean() * W_PER_MM2 == pytest.approx(summary.mean_radiance, rel=1e-6)
    assert summary.nan_pixels == 0


@pytest.mark.slow
@pytest.mark.parametrize("method", ["beam", "point", "reference"])
@pytest.mark.parametrize("mu", VIEWS)
def test_finer_estimates_show_the_radiance_of_a_slab(fine_slab, mu, method):
    seen = view(fine_slab, mu, method, gather_count=NARROWEST if method == "point" else None)
    assert abs(seen.z) < LARGEST_Z, seen
    assert seen.stderr < WANTED_SLOW


TURBID = slab_layer(0.2, 1.0, 9.0, 0.75, 1.4)


@pytest.mark.parametrize("unit", [0.1, 10.0])
def test_equation_3_goes_without_its_scattering_coefficient(unit):
    """A slab drawn in another unit of length is as bright; with the printed factor mu_s it would be `unit` times so.

    Photons are stored where they scatter, so that their density is mu_s x fluence already.
    """
    other = {**TURBID, "thickness_mm": 0.2 / unit, "mu_a_per_mm": unit, "mu_s_per_mm": 9.0 * unit}
    seen = []
    for layer, size_mm, seed in ((TURBID, 0.5, 1), (other, 0.5 / unit, 2)):
        lit = light_up(slab_data([layer], {"kind": "collimated"}, size_mm), 5000, seed=seed)
        assert lit.volume.mu_s[1, 0] == pytest.approx(9.0 if layer is TURBID else 9.0 * unit)
        image, summary = see(lit)
        seen.append((image.multiple_Y.mean(dtype=float) * W_PER_MM2, summary.mean_radiance_stderr))
    (a, a_stderr), (b, b_stderr) = seen
    assert abs(b - a) < LARGEST_Z * math.hypot(a_stderr, b_stderr)
    assert math.hypot(a_stderr, b_stderr) < 0.03 * a
