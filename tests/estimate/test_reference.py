"""The reference estimate: light of known density, flat and under a relief; its noise, its bias, what it leaves out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skinrender.estimate import reference
from skinrender.estimate.scatter_image import MOST_BATCHES
from skinrender.estimate.view_path import make_view_path, relief_arrays
from skinrender.film.camera import view_rays
from skinrender.photonmap.photon_map import PhotonMap
from skinrender.scene.load import make_scene
from skinrender.skin.builder import build_volume
from skinrender.skin.volume import SkinVolume
from skinrender.transport.height_field import first_hit, height
from tests.maps import W_PER_MM2, Lit, light_up, see, slab_data, slab_layer

MU_T, ROUNDS, DEPTH_MM = 20.0, 20, 0.6
WAVES = (0.03 * np.cos(2 * np.pi * np.arange(20) / 20)[:, None] * np.cos(4 * np.pi * np.arange(20) / 20)).astype(
    np.float32
)
CAMERAS = {
    "above": {},
    "aslant": {"zenith_deg": 55, "azimuth_deg": 70},
    "near": {"kind": "perspective", "distance_mm": 3, "zenith_deg": 20, "azimuth_deg": 10},
}


def evenly_lit(camera: dict, n: float, relief_um: float, count: int, seed: int = 1) -> Lit:
    """A slab in which isotropically scattering photons lie evenly, one a mm3 of power 1 / ROUNDS on average."""
    data = slab_data([slab_layer(2.0, 0.5 * MU_T, 0.5 * MU_T, 0.0, n)], {"kind": "collimated"}, 1.0, 4)
    scene = make_scene({**data, "camera": {**data["camera"], **camera}})
    volume = build_volume(scene)
    if relief_um:
        volume = replace(volume, surface_mm=WAVES * np.float32(relief_um / 30.0), z_edges_mm=np.array([-0.1, 2.0]))
    rng = np.random.default_rng(seed)
    low = -0.1 if relief_um else 0.0
    position = rng.uniform([0.0, 0.0, low], [1.0, 1.0, DEPTH_MM], (count, 3)).astype(np.float32)
    if relief_um:
        heights = relief_arrays(volume.surface_mm)[0]
        inside = [z > height(heights, 1.0, 1.0, x, y) for x, y, z in position.astype(float)]
        position = position[np.array(inside)]
    photons = PhotonMap(
        position=position,
        direction=rng.integers(0, 65535, (len(position), 2)).astype(np.uint16),
        band=np.zeros(len(position), np.uint8),
        wavelength_nm=volume.wavelength_nm,
        power_per_band=np.array([(DEPTH_MM - low) / count]),
        emitted_per_band=np.array([count]),
        round_band_start=np.linspace(0, len(position), ROUNDS + 1).astype(np.int64),
        bounds_mm=volume.bounds_mm,
        tallies=np.zeros((ROUNDS, 1, 7), np.int64),
        layer_name=("layer_1",),
        provenance={},
    )
    return Lit(scene, volume, photons)


def even_radiance(lit: Lit, subpixels: int = 40) -> float:
    """Mean over the picture of (1 - F) / n^2 / (4 pi) int exp(-mu_t s) ds, up to where each ray leaves through a
    wall."""
    volume: SkinVolume = lit.volume
    rays = view_rays(lit.scene.camera, volume.size_mm, subpixels)
    view = make_view_path(rays.origin, rays.direction, volume)
    ends = np.full(len(view.hit), np.inf)
    if volume.surface_mm is not None:
        heights, cells = relief_arrays(volume.surface_mm)
        for q in range(len(ends)):
            wall = first_hit(heights, cells, 1.0, 1.0, *view.entry[q], *view.direction[q], 2.0, 1.0)
            ends[q] = wall if wall >= 0.0 else np.inf
    along = (1.0 - np.exp(-MU_T * np.minimum(ends, DEPTH_MM))) / MU_T
    return float((view.transmission[:, 0] * along).mean() / (4.0 * math.pi))


@pytest.mark.parametrize("relief_um", [0.0, 30.0, 80.0])
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("n", [1.0, 1.4])
def test_even_light_is_seen_evenly(camera, n, relief_um):
    """Every Jacobian, fold, shadow and way out of a furrow's wall counts here."""
    check_even_light(evenly_lit(CAMERAS[camera], n, relief_um, 40_000), 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
def test_even_light_is_seen_evenly_to_a_third_of_a_percent(camera):
    check_even_light(evenly_lit(CAMERAS[camera], 1.4, 80.0, 2_000_000), 0.0035)


def check_even_light(lit: Lit, largest_stderr: float) -> None:
    image, summary = see(lit, "reference")
    expected = even_radiance(lit)
    seen = image.multiple_Y.mean(dtype=float) * W_PER_MM2
    assert abs(seen - expected) < 4.0 * summary.mean_radiance_stderr
    assert summary.mean_radiance_stderr < largest_stderr * expected


def test_flat_relief_shows_what_a_flat_surface_shows(monkeypatch):
    monkeypatch.setattr(reference, "LEAST", 0.0)
    flat = evenly_lit(CAMERAS["near"], 1.4, 0.0, 2000)
    relief = flat._replace(volume=replace(flat.volume, surface_mm=np.zeros((8, 8), np.float32)))
    image, _ = see(flat, "reference")
    other, _ = see(relief, "reference")
    assert other.multiple_Y.mean() == pytest.approx(image.multiple_Y.mean(), rel=2e-3)


@pytest.mark.parametrize("name", ["flat", "relief"])
def test_roulette_changes_no_mean(name, monkeypatch):
    lit = evenly_lit(CAMERAS["aslant"], 1.4, 30.0 if name == "relief" else 0.0, 20_000)
    fair, summary = see(lit, "reference")
    monkeypatch.setattr(reference, "LEAST", 0.0)
    full, full_summary = see(lit, "reference")
    assert summary.photons_gathered < 0.8 * full_summary.photons_gathered
    assert abs(summary.mean_radiance - full_summary.mean_radiance) < 2.0 * summary.mean_radiance_stderr
    largest_ratio = stats.f.ppf(0.999, MOST_BATCHES - 1, MOST_BATCHES - 1) ** 0.5
    assert summary.mean_radiance_stderr < largest_ratio * full_summary.mean_radiance_stderr
    assert not np.array_equal(fair.radiance, full.radiance)


def test_beam_without_a_kernel_shows_the_same():
    """On a uniform slab a beam that meets the photons of its own bin alone is the pixel's box."""
    scene = slab_data([slab_layer(1.0, 0.5, 10.0, 0.7, 1.4)], {"kind": "collimated"}, 0.5, 8)
    lit = light_up(scene, 2000)
    _, beam = see(lit, "beam", {"zenith_deg": 40})
    _, exact = see(lit, "reference", {"zenith_deg": 40})
    assert exact.mean_radiance == pytest.approx(beam.mean_radiance, abs=0.5 * beam.mean_radiance_stderr)


def test_claimed_standard_error_is_the_true_one():
    """Over many seeds the pictures scatter as each of them says."""
    seen = [see(evenly_lit({}, 1.4, 0.0, 2000, seed), "reference") for seed in range(40)]
    means = np.array([summary.mean_radiance for _, summary in seen])
    claimed = np.array([summary.mean_radiance_stderr for _, summary in seen])
    ratio = means.var(ddof=1) / np.mean(claimed**2)
    assert stats.chi2.ppf(5e-4, 39) < 39 * ratio < stats.chi2.ppf(1 - 5e-4, 39)
    pixels = np.array([image.radiance[..., 0] for image, _ in seen]) / W_PER_MM2
    errors = np.array([image.stderr_Y for image, _ in seen])
    ratio = pixels.var(axis=0, ddof=1).sum() / (errors**2).mean(axis=0).sum()
    assert 0.8 < ratio < 1.25


def test_remaining_bias_of_a_relief():
    lit = evenly_lit(CAMERAS["aslant"], 1.4, 80.0, 20_000)
    _, summary = see(lit, "reference")
    mesh, left_out = summary.remaining["mesh"], summary.remaining["left_out"]
    assert abs(mesh[0]) < 4.0 * mesh[1] < 0.1
    assert 0.005 < left_out[0] < 0.1
    told = summary.as_json()["remaining_bias"]
    assert told["mesh"] == {"value": mesh[0], "stderr": mesh[1]}


def test_nothing_is_left_out_of_a_thick_flat_slab():
    _, summary = see(evenly_lit({}, 1.4, 0.0, 1000), "reference")
    assert set(summary.remaining) == {"left_out"}
    assert summary.remaining["left_out"][0] < 1e-6


def test_sees_nothing_without_photons():
    lit = evenly_lit({}, 1.4, 30.0, 1000)
    empty = replace(
        lit.photons, position=lit.photons.position[:0], direction=lit.photons.direction[:0],
        band=lit.photons.band[:0], round_band_start=np.zeros(ROUNDS + 1, np.int64),
    )  # fmt: skip
    image, summary = see(lit._replace(photons=empty), "reference")
    assert not image.multiple_Y.any()
    assert summary.nan_pixels == 0
