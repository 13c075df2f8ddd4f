import numpy as np
import pytest

from skinrender.errors import InputError
from skinrender.optics import chromophores

BANDS = np.arange(380.0, 781.0, 5.0)


def test_melanosome_at_the_published_points():
    nm = np.array([380.0, 500.0, 600.0, 780.0])
    assert np.allclose(10 * chromophores.melanosome(nm), [1694, 679, 370, 154], rtol=4e-3)


def test_pheomelanin_is_steeper_and_blends():
    nm = np.array([380.0, 500.0, 600.0, 780.0])
    pheomelanin = chromophores.melanosome(nm, 1.0)
    assert np.allclose(10 * pheomelanin, [1616, 439, 185, 53], rtol=6e-3)
    assert np.allclose(chromophores.melanosome(nm, 0.3), 0.7 * chromophores.melanosome(nm) + 0.3 * pheomelanin)


def test_baseline_at_the_published_points():
    nm = np.array([380.0, 500.0, 600.0, 780.0])
    assert np.allclose(10 * chromophores.baseline(nm), [3.05, 0.702, 0.345, 0.251], rtol=3e-3)


def test_blood_maxima_and_minima():
    nm = np.arange(380.0, 781.0, 2.0)
    oxygenated, deoxygenated = 10 * chromophores.blood(nm, 1.0), 10 * chromophores.blood(nm, 0.0)
    assert nm[oxygenated.argmax()] == 414
    assert nm[deoxygenated.argmax()] in (432, 434)
    assert oxygenated.max() == pytest.approx(2808, rel=1e-3)
    assert deoxygenated.max() == pytest.approx(2957, rel=1e-3)
    assert oxygenated.min() == pytest.approx(1.46, rel=0.01)


@pytest.mark.parametrize("nm", [390.0, 422.0, 452.4, 500.1, 529.2, 545.3, 570.2, 584.1, 796.8])
def test_isosbestic_points_do_not_depend_on_saturation(nm):
    at = np.array([nm])
    assert chromophores.blood(at, 1.0) == pytest.approx(chromophores.blood(at, 0.0), rel=1e-2)


def test_vessel_flattening_closed_form_and_limits():
    mu_a = np.array([0.0, 1e-12, 1e-9, 1.0, 281.0, 1e12])
    kept = chromophores.vessel_flattening(mu_a, 0.01)
    assert kept[0] == 1.0
    assert np.allclose(kept[1:3], 1.0, atol=1e-10)
    assert kept[3] == pytest.approx((1 - np.exp(-0.02)) / 0.02)
    assert kept[5] == pytest.approx(1 / (0.02 * 1e12))
    assert np.all(np.diff(kept) <= 0)
    assert np.all(chromophores.vessel_flattening(mu_a, 0.0) == 1.0)


@pytest.mark.parametrize(("radius_um", "at_414", "at_542"), [(4, 0.40, 0.89), (10, 0.18, 0.76), (25, 0.07, 0.53)])
def test_vessel_flattening_of_oxygenated_blood(radius_um, at_414, at_542):
    mu_a = chromophores.blood(np.array([414.0, 542.0, 650.0]), 1.0)
    assert np.allclose(chromophores.vessel_flattening(mu_a, radius_um * 1e-3), [at_414, at_542, 1.0], atol=0.011)


def test_water_is_negligible_in_the_visible():
    assert np.all(chromophores.water(BANDS) > 0)
    assert np.all(chromophores.water(BANDS) < 0.003)


def test_carotene_and_bilirubin_follow_beers_law():
    assert chromophores.carotene(np.array([451.0]), 2.1e-4)[0] == pytest.approx(0.0126, rel=0.02)
    assert chromophores.bilirubin(np.array([450.8]), 0.05)[0] == pytest.approx(
        np.log(10) * 55000 * 0.05 / 585 / 10, rel=0.01
    )
    assert np.allclose(chromophores.bilirubin(BANDS, 0.2), 4 * chromophores.bilirubin(BANDS, 0.05))


def test_bands_that_were_not_measured_are_refused():
    with pytest.raises(InputError, match="850 nm"):
        chromophores.blood(np.array([850.0]), 0.7)
