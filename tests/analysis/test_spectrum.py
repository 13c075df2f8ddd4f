from __future__ import annotations

import csv

import numpy as np
import pytest
from skimage import io

import skinrender
from skinrender.analysis.spectrum import lesion_regions, propagated
from skinrender.analysis.spectrum_files import draw_spectrum, write_csv
from skinrender.film.color import lab_of_factor
from skinrender.scene import make_scene

CLEAR = {"thickness_mm": 1, "mu_a_per_mm": 0, "mu_s_per_mm": 0, "g": 0, "refractive_index": 1.5}
NM = np.arange(400.0, 701.0, 20.0)


def slab_scene(bands_nm=NM, **layer):
    return make_scene(
        {"name": "slab", "patch": {"size_mm": [1, 1], "columns": [1, 1]}, "bands_nm": list(bands_nm), "sides": "open",
         "slab": {"layers": [CLEAR | layer]}, "light": {"kind": "sky"}}
    )  # fmt: skip


def fresnel(n: float, degrees: float) -> float:
    """Reflectance of a surface for unpolarized light."""
    cos_i = np.cos(np.radians(degrees))
    cos_t = np.sqrt(1.0 - (np.sin(np.radians(degrees)) / n) ** 2)
    s, p = (cos_i - n * cos_t) / (cos_i + n * cos_t), (n * cos_i - cos_t) / (n * cos_i + cos_t)
    return 0.5 * (s * s + p * p)


def test_black_glass_reflects_at_its_surface_alone():
    found = skinrender.spectrum(slab_scene(mu_a_per_mm=100), stderr=0.05, workers=1)
    z = (found.patch.total - fresnel(1.5, 8.0)) / found.patch.total_stderr
    assert np.abs(z).max() < 4.5
    assert not found.patch.diffuse.any()


def test_milk_sends_everything_back_and_is_white():
    found = skinrender.spectrum(slab_scene((450, 550, 650, 660), mu_s_per_mm=25, thickness_mm=4), stderr=0.005, workers=1)
    assert 0.96 < found.patch.total.mean() < 1.0
    assert found.patch.color.lab[0] == pytest.approx(100.0, abs=2.0)
    assert found.patch.color.melanin_index[0] == pytest.approx(0.0, abs=3.0)


def test_seconds_and_files(tmp_path):
    found = skinrender.spectrum(slab_scene(mu_s_per_mm=5, mu_a_per_mm=1), stderr=0.05, workers=1)
    assert found.measured is None and found.inside is None
    write_csv(found, tmp_path / "spectrum.csv")
    draw_spectrum(found, tmp_path / "spectrum.png")
    with open(tmp_path / "spectrum.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["wavelength_nm"]) for row in rows] == NM.tolist()
    assert [float(row["reflectance"]) for row in rows] == pytest.approx(found.patch.total, rel=1e-5)
    assert io.imread(tmp_path / "spectrum.png").std() > 0


@pytest.fixture(scope="module")
def lesion_scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lesion")
    gray = np.full((6, 6), 255, np.uint8)
    gray[1:5, 1:5], gray[2:4, 2:4] = 200, 0
    io.imsave(folder / "spot.png", gray, check_contrast=False)
    return make_scene(
        {"name": "spot", "patch": {"size_mm": [6, 6], "columns": [6, 6]}, "bands_nm": [450, 550, 655], "skin": {},
         "relief": {"kind": "flat"}, "lesions": [{"kind": "epidermal", "pattern": "spot.png", "melanin_scale": 0.3}]},
        source_dir=folder,
    )  # fmt: skip


def test_regions_are_over_half_the_maximum_and_at_zero(lesion_scene):
    inside, outside = lesion_regions(lesion_scene)
    assert inside.sum() == 4 and inside[2:4, 2:4].all()
    assert outside.sum() == 20 and not outside[1:5, 1:5].any()


def test_a_macule_is_darker_inside(lesion_scene):
    found = skinrender.spectrum(lesion_scene, stderr=0.015, workers=1)
    assert found.inside_share == pytest.approx(4 / 36) and found.outside_share == pytest.approx(20 / 36)
    assert found.difference.total == pytest.approx(found.inside.total - found.outside.total)
    assert np.all(found.difference.total + 4 * found.difference.total_stderr < 0)
    assert found.difference.color.lab == pytest.approx(found.inside.color.lab - found.outside.color.lab)
    assert np.all(found.patch.total < found.outside.total + 4 * found.outside.total_stderr)
    assert found.as_json()["regions"].keys() == {"inside", "outside", "difference"}


def test_propagation_is_exact_for_linear_functions():
    values, covariance = np.array([[1.0, 2.0], [3.0, 5.0]]), np.array([[[4.0, 1.0], [1.0, 9.0]]] * 2)
    value, stderr = propagated(lambda r: (r[..., 0, :] - r[..., 1, :]).sum(axis=-1)[..., None], values, covariance)
    assert value == pytest.approx([-3.0])
    assert stderr == pytest.approx([np.sqrt(2 * (4 + 9 - 2))])


def test_propagated_errors_of_colors_are_those_of_samples():
    reflectance, stderr = 0.2 + 0.3 * (NM - 400.0) / 300.0, np.full(NM.size, 0.004)
    samples = np.random.default_rng(1).normal(reflectance, stderr, (4000, NM.size))
    spread = lab_of_factor(samples, NM).std(axis=0)
    value, error = propagated(
        lambda r: lab_of_factor(r[..., 0, :], NM), reflectance[:, None], (stderr**2)[:, None, None]
    )
    assert value == pytest.approx(lab_of_factor(reflectance, NM))
    assert error == pytest.approx(spread, rel=0.06)
