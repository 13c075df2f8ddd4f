from dataclasses import replace

import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics import chromophores, tables
from skinrender.optics.tissue import Tissue, absorption, anisotropy, reduced_scattering, tissue_optics

BANDS = np.arange(380.0, 781.0, 5.0)

# Per cm, worked out independently: mu_a at 380 420 500 545 600 700 780 nm (545: mean of 540 and 550), mu_s at
# 380 500 600 780 nm.
FOREARM = {
    "stratum_corneum": ([7.67, 5.15, 2.63, 1.93, 1.40, 0.891, 0.679], [427, 284, 248, 248]),
    "granular_spinous": ([38.5, 27.4, 15.2, 11.4, 8.28, 4.98, 3.51], [427, 284, 248, 248]),
    "basal": ([187, 134, 75.0, 56.3, 40.8, 24.5, 17.1], [427, 284, 248, 248]),
    "papillary": ([2.07, 2.77, 0.460, 0.637, 0.192, 0.105, 0.111], [310, 186, 155, 150]),
    "subpapillary": ([2.49, 3.36, 0.563, 0.855, 0.227, 0.109, 0.116], [310, 186, 155, 150]),
    "upper_plexus": ([6.52, 8.06, 1.75, 3.22, 0.678, 0.161, 0.168], [310, 186, 155, 150]),
    "reticular": ([1.64, 1.53, 0.411, 0.549, 0.174, 0.092, 0.100], [310, 186, 155, 150]),
    "lower_plexus": ([2.07, 1.73, 0.724, 1.02, 0.315, 0.110, 0.117], [310, 186, 155, 150]),
    "subcutis": ([1.07, 1.15, 0.336, 0.573, 0.123, 0.029, 0.032], [208, 146, 132, 138]),
}


def layers(site):
    return {row["layer"]: tissue(row) for row in tables.read_rows("skin_layers.csv") if row["site"] == site}


def tissue(row):
    same = ("melanosome", "blood", "vessel_radius_um", "water", "fat")
    return Tissue(
        **{name: float(row[name]) for name in same},
        saturation=float(row["S"]),
        cauchy_a=float(row["n_A"]),
        cauchy_b_nm2=float(row["n_B"]),
        musp_500nm_per_mm=float(row["a_per_cm"]) / 10,
        rayleigh_fraction=float(row["f_ray"]),
        mie_power=float(row["b_mie"]),
    )


def test_both_sites_have_the_same_nine_layers():
    assert list(layers("forearm")) == list(layers("cheek")) == list(FOREARM)


@pytest.mark.parametrize("layer", FOREARM)
def test_forearm_coefficients(layer):
    mu_a, mu_s = FOREARM[layer]
    nm = np.array([380.0, 420.0, 500.0, 540.0, 550.0, 600.0, 700.0, 780.0])
    got = 10 * tissue_optics(layers("forearm")[layer], nm).mu_a
    got = np.concatenate([got[:3], [(got[3] + got[4]) / 2], got[5:]])
    assert np.allclose(got, mu_a, rtol=4e-3, atol=6e-4)
    assert np.allclose(10 * tissue_optics(layers("forearm")[layer], nm[[0, 2, 5, 7]]).mu_s, mu_s, rtol=4e-3)


def test_refractive_index_follows_cauchy():
    nm = np.array([400.0, 500.0, 600.0, 700.0])
    forearm = layers("forearm")
    assert np.allclose(tissue_optics(forearm["basal"], nm).refractive_index, [1.463, 1.445, 1.435, 1.430], atol=6e-4)
    assert np.allclose(
        tissue_optics(forearm["reticular"], nm).refractive_index, [1.394, 1.385, 1.381, 1.378], atol=6e-4
    )
    assert np.all(tissue_optics(forearm["stratum_corneum"], nm).refractive_index == 1.5)


def test_scattering_keeps_its_reduced_coefficient():
    epidermis = layers("forearm")["basal"]
    optics = tissue_optics(epidermis, BANDS)
    assert np.allclose(optics.mu_s * (1 - optics.g), reduced_scattering(epidermis, BANDS))
    assert reduced_scattering(epidermis, np.array([500.0]))[0] == pytest.approx(6.67)
    assert np.allclose(anisotropy(np.array([380.0, 500.0, 780.0])), [0.7302, 0.765, 0.8462])


def test_many_melanosome_fractions_at_once_equal_one_by_one():
    basal = layers("cheek")["basal"]
    fractions = np.array([0.0, 0.1, 0.45, 1.0])
    together = tissue_optics(basal, BANDS, fractions)
    assert together.mu_a.shape == (4, 81)
    assert together.mu_s.shape == together.g.shape == together.refractive_index.shape == (81,)
    for row, fraction in zip(together.mu_a, fractions, strict=True):
        assert np.allclose(row, absorption(replace(basal, melanosome=fraction), BANDS), rtol=1e-14)


def test_pure_substances_are_corners_of_the_mixture():
    for share in (0.0, 0.4):
        pigment = Tissue(melanosome=1, pheomelanin=share)
        assert np.allclose(absorption(pigment, BANDS), chromophores.melanosome(BANDS, share))
    assert np.allclose(absorption(Tissue(blood=1, saturation=0.3), BANDS), chromophores.blood(BANDS, 0.3))
    assert np.allclose(absorption(Tissue(water=1), BANDS), chromophores.water(BANDS))
    assert np.allclose(absorption(Tissue(fat=1), BANDS), chromophores.fat(BANDS))
    assert np.allclose(absorption(Tissue(), BANDS), chromophores.baseline(BANDS))
    dissolved = absorption(Tissue(carotene_g_per_l=1, bilirubin_g_per_l=2), BANDS) - chromophores.baseline(BANDS)
    assert np.allclose(dissolved, chromophores.carotene(BANDS, 1) + chromophores.bilirubin(BANDS, 2))


def test_vessels_hide_some_of_the_blood():
    spread = Tissue(blood=0.05, saturation=0.7)
    assert np.all(absorption(replace(spread, vessel_radius_um=25), BANDS) < absorption(spread, BANDS))


def test_bloodless_tissue_needs_no_hemoglobin_table():
    assert np.isfinite(absorption(Tissue(melanosome=0.1), np.array([1064.0]))).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"melanosome": 1.1},
        {"blood": -0.1},
        {"saturation": np.nan},
        {"water": 0.6, "fat": 0.5},
        {"vessel_radius_um": -1},
        {"musp_500nm_per_mm": np.inf},
    ],
)
def test_impossible_compositions_are_refused(wrong):
    with pytest.raises(InputError):
        Tissue(**wrong)


def test_impossible_melanosome_fractions_are_refused():
    with pytest.raises(InputError):
        absorption(Tissue(), BANDS, np.array([0.5, 1.5]))
