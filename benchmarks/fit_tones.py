"""Fit the tones of skin (skinrender/optics/data/skin_tones.csv) to the NIST volar forearms: make fit-tones.

What is fitted: three factors on the forearm preset, of the melanin in the basal layer, of the melanin above it and of
the blood. Everything else stays, and no layer gets a larger share of melanosomes than the basal one. To what: the mean
reflectance of an ITA class, 400 to 700 nm in units of the class's standard deviation, and its color. To which classes:
very light, intermediate and brown. Between them each factor is exp of a parabola in ITA, which gives light and tan:
these two classes are not looked at, they are the test.

The walk is replaced by a polynomial through walks on a grid of the factors with common random numbers (its residuals are
printed); the verdict is that of `make measured-skin`, from the walk itself.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.optimize import minimize

from skinrender.analysis.light_counts import balance, controlled_mean, count_rounds
from skinrender.analysis.spectrum import lit_pass
from skinrender.film.color import delta_e, ita_deg, lab_of_factor
from skinrender.optics.measured_skin import MeasuredSkin, measured_tone
from skinrender.scene import make_scene
from skinrender.skin.anatomy import multiplied, site_layers
from skinrender.skin.builder import build_volume
from skinrender.transport import tally

FITTED, TESTED = ("very_light", "intermediate", "brown"), ("light", "tan")
BASAL, UPPER, BLOOD = (0.15, 0.5, 1.6, 5.0), (0.2, 0.6, 1.5, 4.0, 9.0), (0.8, 1.7, 3.2)
HISTORIES, ROUNDS, SEED = 1000, 8, 1
NM = np.arange(380.0, 781.0, 20.0)
FITTED_NM = (400.0, 700.0)
BASAL_TO_SPINOUS = 5.0
"""Of the shares of melanosomes in the preset."""
COLOR_WEIGHT = 0.25
"""Of a squared color difference (CIEDE2000) beside the mean squared deviation in standard deviations."""


def main() -> None:
    """Print the factors of each tone as rows of the table."""
    coefficients = fitted_polynomial()
    classes = {name: measured_tone(name) for name in (*FITTED, *TESTED)}
    angle = {name: float(ita_deg(lab_of_factor(m.on_bands(NM)[0], NM))) for name, m in classes.items()}
    best = [fit(coefficients, classes[name]) for name in FITTED]
    curve = np.polyfit([angle[name] for name in FITTED], best, 2)
    for name in sorted(angle, key=angle.get, reverse=True):
        factors = np.polyval(curve, angle[name])
        row = ",".join([name, *(f"{factor:.3g}" for factor in np.exp(factors))])
        print(f"{row}   # ITA {angle[name]:.1f}: {verdict(coefficients, factors, classes[name])}")


def fitted_polynomial() -> np.ndarray:
    """Coefficients of ln R by band, cubic in the logarithms of the factors."""
    grid = list(itertools.product(BASAL, UPPER, BLOOD))
    walked = np.log([reflectance(*factors) for factors in grid])
    terms = _terms(np.log(grid))
    coefficients, *_ = np.linalg.lstsq(terms, walked, rcond=None)
    print(f"# {len(grid)} walks, {terms.shape[1]} terms, residual {100 * (terms @ coefficients - walked).std():.2g} %")
    return coefficients


def reflectance(basal: float, upper: float, blood: float) -> np.ndarray:
    """Reflectance (B,) of the flat forearm with its melanin and blood multiplied."""
    layers = {}
    for layer in site_layers("forearm"):
        tissue = multiplied(layer.tissue, basal if layer.name == "basal" else upper, blood)
        layers[layer.name] = {"melanosome": tissue.melanosome, "blood": tissue.blood}
    scene = make_scene(
        {"patch": {"size_mm": [10, 10], "columns": [1, 1]}, "bands_nm": NM.tolist(), "relief": {"kind": "flat"},
         "skin": {"layers": layers, "border_wave": {"peak_to_valley_um": 0}}}
    )  # fmt: skip
    volume = build_volume(scene)
    counts = count_rounds(lit_pass(volume, SEED), np.full(NM.size, HISTORIES), ROUNDS)
    reflected = counts.tallies[..., tally.REFLECTED, None] / HISTORIES
    return controlled_mean(reflected, balance(volume, counts))[0][:, 0]


def fit(coefficients: np.ndarray, measured: MeasuredSkin) -> np.ndarray:
    """Logarithms of the three factors that bring the forearm nearest to a measured class."""
    mean, sd = measured.on_bands(NM)
    used = (NM >= FITTED_NM[0]) & (NM <= FITTED_NM[1])
    lab = lab_of_factor(mean, NM)
    bounds = [(np.log(axis[0]), np.log(axis[-1])) for axis in (BASAL, UPPER, BLOOD)]

    def cost(factors: np.ndarray) -> float:
        r = np.exp(_terms(factors) @ coefficients)
        upside_down = max(0.0, factors[1] - factors[0] - np.log(BASAL_TO_SPINOUS))
        color = delta_e(lab_of_factor(r, NM), lab)
        return float(np.mean(((r - mean) / sd)[used] ** 2) + COLOR_WEIGHT * color**2 + 100.0 * upside_down**2)

    starts = ([0.0, 0.0, 0.5], [1.0, 1.0, 0.5], [-0.8, -0.8, 0.5])
    return min((minimize(cost, x0, method="Nelder-Mead", bounds=bounds) for x0 in starts), key=lambda got: got.fun).x


def verdict(coefficients: np.ndarray, factors: np.ndarray, measured: MeasuredSkin) -> str:
    """How far a tone is from its class, by the polynomial."""
    mean, sd = measured.on_bands(NM)
    r = np.exp(_terms(factors) @ coefficients)
    z = np.abs((r - mean) / sd)[(NM >= FITTED_NM[0]) & (NM <= FITTED_NM[1])]
    return f"dE00 {delta_e(lab_of_factor(r, NM), lab_of_factor(mean, NM)):.2f}, at most {z.max():.1f} SD off"


def _terms(logarithms: np.ndarray) -> np.ndarray:
    """Products (..., 20) of at most three of the logarithms (..., 3) of the factors."""
    one = np.concatenate([np.ones((*np.shape(logarithms)[:-1], 1)), logarithms], axis=-1)
    triples = itertools.combinations_with_replacement(range(4), 3)
    return np.stack([np.prod(one[..., list(triple)], axis=-1) for triple in triples], axis=-1)


if __name__ == "__main__":
    main()
