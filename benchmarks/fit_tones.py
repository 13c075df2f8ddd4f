"""Fit the tones of skin (skinrender/optics/data/skin_tones.csv) to the NIST volar forearms: make fit-tones.

To what: the mean reflectance of an ITA class, 380 to 780 nm, in units of the class's standard deviation. To which classes:
very light, intermediate and brown. What: in each, the fraction of melanosomes in the basal layer and above it; for all
three together, one factor on the blood of the forearm preset and the share of pheomelanin: in steps of 0.1 the one that
keeps these classes deepest inside the range of their subjects. Everything else stays, oxygen saturation and the bottom of
the volume among it. Through the three classes each fraction is a parabola in ITA; light and tan are read off it: these two
classes are not looked at, they are the test.

The stratum corneum holds as many melanosomes in its dry substance as the living cells below that become it, so more in its
volume, since it has lost water; the basal layer holds at least as many as that.

The reflectance is that of paths walked once without absorption (benchmarks/path_lengths.py); the verdict is that of
`make measured-skin`, from the walk itself.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from benchmarks.path_lengths import Paths, volume_paths
from skinrender.analysis.tool import options, tool
from skinrender.film.color import delta_e, ita_deg, lab_of_factor
from skinrender.optics.measured_skin import TONES, measured_tone
from skinrender.optics.tissue import absorption
from skinrender.scene import make_scene
from skinrender.skin.anatomy import EPIDERMIS, LayerSpec, Tone
from skinrender.skin.builder import build_volume, scene_layers

FITTED = ("very_light", "intermediate", "brown")
PHOTONS, SEED = 100_000, 1
NM = np.arange(380.0, 781.0, 10.0)
SHARES = np.arange(0, 11) / 10
START_BASAL, START_ABOVE, START_BLOOD = (0.06, 0.08, 0.2), 0.5, 2.0
"""Of the fitted classes; the fraction in the stratum corneum is given as a share of the basal one."""


class Forearm:
    """The forearm's reflectance in any tone.

    Parameters
    ----------
    subcutis_mm : thickness of the lowest layer; None = the preset's.
    """

    def __init__(self, subcutis_mm: float | None = None) -> None:
        changed = {} if subcutis_mm is None else {"subcutis": {"thickness_um": 1000.0 * subcutis_mm}}
        scene = make_scene(
            {"patch": {"size_mm": [10, 10], "columns": [1, 1]}, "bands_nm": NM.tolist(), "relief": {"kind": "flat"},
             "skin": {"layers": changed, "border_wave": {"peak_to_valley_um": 0}}}
        )  # fmt: skip
        self.layers: Sequence[LayerSpec] = scene_layers(scene)
        self.paths: list[Paths] = volume_paths(build_volume(scene), PHOTONS, SEED)

    def tone(self, basal: float, above: float, blood: float, pheomelanin: float) -> Tone:
        """The tone with these melanosome fractions of the basal layer and of the stratum corneum."""
        own = {layer.name: layer.tissue for layer in self.layers}
        dry = {name: 1.0 - own[name].water for name in EPIDERMIS}
        fractions = (above, above * dry["granular_spinous"] / dry["stratum_corneum"], basal)
        melanin = {name: fraction / own[name].melanosome for name, fraction in zip(EPIDERMIS, fractions)}
        return Tone(melanin, blood, pheomelanin)

    def reflectance(self, tone: Tone) -> np.ndarray:
        """Reflectance (B,) of the flat forearm, specular included."""
        tissues = [tone.on(layer.tissue, layer.name) for layer in self.layers]
        mu_a = np.stack([absorption(tissue, NM) for tissue in tissues])
        return np.array([paths.reflectance(mu_a[:, band]) for band, paths in enumerate(self.paths)])


def fit(forearm: Forearm, pheomelanin: float) -> dict[str, Tone]:
    """The tone of each fitted class with a share of pheomelanin."""
    measured = [measured_tone(name).on_bands(NM) for name in FITTED]

    def tones(x: np.ndarray) -> list[Tone]:
        return [forearm.tone(basal, basal * above, x[0], pheomelanin) for basal, above in x[1:].reshape(-1, 2)]

    def deviations(x: np.ndarray) -> np.ndarray:
        return np.concatenate([(forearm.reflectance(tone) - mean) / sd for tone, (mean, sd) in zip(tones(x), measured)])

    start = [START_BLOOD, *(value for basal in START_BASAL for value in (basal, START_ABOVE))]
    low, high = [0.5] + [1e-3, 0.0] * len(FITTED), [8.0] + [1.0, 1.0] * len(FITTED)
    found = least_squares(deviations, start, bounds=(low, high), diff_step=1e-2, x_scale="jac")
    return dict(zip(FITTED, tones(found.x)))


def deepest(forearm: Forearm) -> dict[str, Tone]:
    """The fit with the share of pheomelanin that keeps the fitted classes deepest inside the range of their subjects."""
    fits = [fit(forearm, share) for share in SHARES]
    depths = [min(margin(forearm.reflectance(tone), name).min() for name, tone in tones.items()) for tones in fits]
    for share, depth in zip(SHARES, depths):
        print(f"# pheomelanin {share:.1f}: the fitted classes at least {depth:.2f} SD inside")
    return fits[int(np.argmax(depths))]


def between(fitted: Mapping[str, Tone], ita: Mapping[str, float]) -> dict[str, Tone]:
    """All tones, rounded; those that are not fitted by a parabola in ITA for the melanin of each layer."""
    angles = [ita[name] for name in FITTED]
    curve = {layer: np.polyfit(angles, [fitted[name].melanin[layer] for name in FITTED], 2) for layer in EPIDERMIS}
    one = fitted[FITTED[0]]
    return {
        name: Tone(
            {layer: float(f"{np.polyval(curve[layer], ita[name]):.3g}") for layer in EPIDERMIS},
            float(f"{one.blood:.3g}"),
            one.pheomelanin,
        )
        for name in TONES
    }


def margin(reflectance: np.ndarray, name: str) -> np.ndarray:
    """How deep (B,) inside the range of a class's subjects, in standard deviations; negative: outside."""
    measured = measured_tone(name)
    _, sd = measured.on_bands(NM)
    least, largest = (np.interp(NM, measured.wavelength_nm, of) for of in (measured.least, measured.largest))
    return np.minimum(reflectance - least, largest - reflectance) / sd


def verdict(reflectance: np.ndarray, name: str) -> str:
    """How far a tone is from its class, and where it is nearest to the end of the range."""
    mean, sd = measured_tone(name).on_bands(NM)
    color = delta_e(lab_of_factor(reflectance, NM), lab_of_factor(mean, NM))
    deviation, depth = np.abs((reflectance - mean) / sd).max(), margin(reflectance, name)
    role = "fitted" if name in FITTED else "test"
    inside = f"{depth.min():.2f} SD inside at {NM[depth.argmin()]:.0f} nm"
    return f"{role}: dE00 {color:.2f}, at most {deviation:.2f} SD off, {inside}"


@tool
def main(arguments: Sequence[str] | None) -> None:
    """Print the tones as rows of the table."""
    parser = options(__doc__)
    parser.add_argument("--subcutis-mm", type=float, help="thickness of the lowest layer in place of the preset's")
    forearm = Forearm(parser.parse_args(arguments).subcutis_mm)
    ita = {name: float(ita_deg(lab_of_factor(measured_tone(name).on_bands(NM)[0], NM))) for name in TONES}
    for name, tone in between(deepest(forearm), ita).items():
        factors = ",".join(f"{factor:.3g}" for factor in (*tone.melanin.values(), tone.blood, tone.pheomelanin))
        print(f"{name},{ita[name]:.1f},{factors}   # {verdict(forearm.reflectance(tone), name)}")


if __name__ == "__main__":
    sys.exit(main())
