"""Fit the tones of skin (skinrender/optics/data/skin_tones.csv) to the NIST volar forearms: make fit-tones.

To what: the mean reflectance of an ITA class, 380 to 780 nm, in units of the class's standard deviation. To which classes:
very light, intermediate and brown. What: in each, the fraction of melanosomes in the basal layer and above it; for all
three together, the share of pheomelanin and one factor on the blood of the forearm preset. Everything else stays, oxygen
saturation and the bottom of the volume among it. Through the three classes each fraction is a parabola in ITA; light and
tan are read off it: these two classes are not looked at, they are the test.

The stratum corneum holds as many melanosomes in its dry substance as the living cells below that become it, so more in its
volume, since it has lost water; the basal layer holds at least as many as those.

The reflectance is that of paths walked once without absorption (benchmarks/path_lengths.py); the verdict is that of
`make measured-skin`, from the walk itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from benchmarks.path_lengths import Paths, volume_paths
from skinrender.film.color import delta_e, ita_deg, lab_of_factor
from skinrender.optics.measured_skin import TONES, measured_tone
from skinrender.optics.tissue import absorption
from skinrender.scene import make_scene
from skinrender.skin.anatomy import EPIDERMIS, LayerSpec, Tone
from skinrender.skin.builder import build_volume, scene_layers

FITTED = ("very_light", "intermediate", "brown")
PHOTONS, SEED = 100_000, 1
NM = np.arange(380.0, 781.0, 20.0)
START = {"very_light": (0.06, 0.3), "intermediate": (0.08, 0.4), "brown": (0.2, 0.4)}
"""Basal fraction, and what is above it as a share of that."""


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
        self.own = {layer.name: layer.tissue for layer in self.layers}

    def tone(self, basal: float, upper: float, blood: float, pheomelanin: float) -> Tone:
        """The tone with these melanosome fractions of the basal and of the granular and spinous layer."""
        dry = {name: 1.0 - self.own[name].water for name in EPIDERMIS}
        kept = dry["stratum_corneum"] / dry["granular_spinous"]
        fractions = dict(zip(EPIDERMIS, (upper * kept, upper, basal)))
        return Tone({name: fractions[name] / self.own[name].melanosome for name in EPIDERMIS}, blood, pheomelanin)

    def reflectance(self, tone: Tone) -> np.ndarray:
        """Reflectance (B,) of the flat forearm, specular included."""
        tissues = [tone.on(layer.tissue, layer.name) for layer in self.layers]
        mu_a = np.stack([absorption(tissue, NM) for tissue in tissues])
        return np.array([paths.reflectance(mu_a[:, band]) for band, paths in enumerate(self.paths)])


def fit(forearm: Forearm) -> dict[str, Tone]:
    """The tone of each fitted class."""
    measured = [measured_tone(name).on_bands(NM) for name in FITTED]

    def tones(x: np.ndarray) -> list[Tone]:
        blood, pheomelanin = x[:2]
        return [forearm.tone(basal, basal * share, blood, pheomelanin) for basal, share in x[2:].reshape(-1, 2)]

    def deviations(x: np.ndarray) -> np.ndarray:
        return np.concatenate([(forearm.reflectance(tone) - mean) / sd for tone, (mean, sd) in zip(tones(x), measured)])

    start = [2.0, 0.5, *(value for name in FITTED for value in START[name])]
    low, high = [0.5, 0.0] + [1e-3, 0.0] * len(FITTED), [8.0, 1.0] + [1.0, 1.0] * len(FITTED)
    found = least_squares(deviations, start, bounds=(low, high), diff_step=1e-2, x_scale="jac")
    return dict(zip(FITTED, tones(found.x)))


def between(fitted: Mapping[str, Tone], ita: Mapping[str, float]) -> dict[str, Tone]:
    """All tones: those that are not fitted by a parabola in ITA for the melanin of each layer."""
    angles = [ita[name] for name in FITTED]
    curve = {layer: np.polyfit(angles, [fitted[name].melanin[layer] for name in FITTED], 2) for layer in EPIDERMIS}
    tones = {}
    for name in TONES:
        melanin = {layer: float(f"{np.polyval(curve[layer], ita[name]):.3g}") for layer in EPIDERMIS}
        tones[name] = Tone(melanin, *(float(f"{getattr(fitted[FITTED[0]], key):.3g}") for key in ("blood", "pheomelanin")))
    return tones


def verdict(reflectance: np.ndarray, name: str) -> str:
    """How far a tone is from its class, and how deep inside the range of its subjects (negative: outside)."""
    measured = measured_tone(name)
    mean, sd = measured.on_bands(NM)
    least, largest = (np.interp(NM, measured.wavelength_nm, of) for of in (measured.least, measured.largest))
    margin = np.minimum(reflectance - least, largest - reflectance) / sd
    color = delta_e(lab_of_factor(reflectance, NM), lab_of_factor(mean, NM))
    deviation = np.abs((reflectance - mean) / sd).max()
    role = "fitted" if name in FITTED else "test"
    nearest = f"{margin.min():.2f} SD inside at {NM[margin.argmin()]:.0f} nm"
    return f"{role}: dE00 {color:.2f}, at most {deviation:.2f} SD off, {nearest}"


def main() -> None:
    """Print the tones as rows of the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--subcutis-mm", type=float, help="thickness of the lowest layer in place of the preset's")
    forearm = Forearm(parser.parse_args().subcutis_mm)
    ita = {name: float(ita_deg(lab_of_factor(measured_tone(name).on_bands(NM)[0], NM))) for name in TONES}
    for name, tone in between(fit(forearm), ita).items():
        numbers = (ita[name], *tone.melanin.values(), tone.blood, tone.pheomelanin)
        row = ",".join([name, f"{numbers[0]:.1f}", *(f"{number:.3g}" for number in numbers[1:])])
        print(f"{row}   # {verdict(forearm.reflectance(tone), name)}")


if __name__ == "__main__":
    main()
