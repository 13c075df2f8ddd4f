"""The diffuse reflectance of a scene's skin at each wavelength, and its color, from the photon walk alone.

As an integrating sphere sees it: parallel light from 8 degrees on the whole patch, everything that comes back counted,
relative to a perfect white. The sides are periodic. The surface is smooth (its relief is what the scene says, its
roughness is not), so that `specular` is the light that never entered, after one reflection or, in a furrow, several.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from skinrender.analysis.light_counts import (
    ROUNDS,
    LightCounts,
    balance,
    controlled_mean,
    count_rounds,
    settle_histories,
)
from skinrender.engine.clock import StageClock
from skinrender.engine.rounds import PILOT_SEED
from skinrender.film.color import ita_deg, lab_of_factor, shows_color
from skinrender.film.skin_color import erythema_index, ita_class, melanin_index
from skinrender.optics.illuminants import band_weights
from skinrender.optics.measured_skin import MeasuredSkin, measured_at
from skinrender.photonmap.light import CollimatedLight, flight_direction
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.scene import Scene
from skinrender.skin.builder import build_volume
from skinrender.skin.pattern import read_pattern
from skinrender.skin.volume import SkinVolume
from skinrender.transport import tally

INCIDENCE_DEG = 8.0
STDERR = 0.002
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class SkinColor:
    """Color of a reflectance, specular included, under D65 for the 2 degree observer; values with standard errors.

    Parameters
    ----------
    lab, lab_stderr : (3,) CIE L*a*b*, or differences of it.
    melanin_index, erythema_index : (value, standard error), see `film.skin_color`; not numbers where bands are missing.
    ita_deg : (value, standard error); None for a difference and for bands that cannot show color.
    """

    lab: np.ndarray
    lab_stderr: np.ndarray
    melanin_index: tuple[float, float]
    erythema_index: tuple[float, float]
    ita_deg: tuple[float, float] | None = None

    def as_json(self) -> dict[str, Any]:
        """The JSON of a color."""
        angle = self.ita_deg
        return {
            "lab": {name: _pair(*pair) for name, *pair in zip("Lab", self.lab, self.lab_stderr)},
            "ita_deg": None if angle is None else _pair(*angle),
            "ita_class": None if angle is None else ita_class(angle[0]),
            "melanin_index": _pair(*self.melanin_index),
            "erythema_index": _pair(*self.erythema_index),
        }


@dataclass(frozen=True, eq=False)
class Reflectance:
    """Reflectances of a patch or of a part of it, or their difference; B bands.

    Parameters
    ----------
    total, total_stderr : (B,) specular included.
    diffuse, diffuse_stderr : (B,) specular excluded.
    color : of `total`.
    """

    total: np.ndarray
    total_stderr: np.ndarray
    diffuse: np.ndarray
    diffuse_stderr: np.ndarray
    color: SkinColor

    def as_json(self) -> dict[str, Any]:
        """Reflectances and color in JSON."""
        return {
            "reflectance": _pairs(self.total, self.total_stderr),
            "specular_excluded": _pairs(self.diffuse, self.diffuse_stderr),
            **self.color.as_json(),
        }


@dataclass(frozen=True, eq=False)
class SkinSpectrum:
    """What ``skinrender spectrum`` reports.

    Parameters
    ----------
    name : of the scene.
    wavelength_nm : (B,).
    patch : the whole patch.
    inside, outside, difference : on a scene with lesions, else None. Inside are the voxel columns where a pattern is
        over half its maximum, outside those where all patterns are 0. The light falls on the whole patch, evenly; that
        which leaves through these columns, over that which falls on them, is their reflectance. Specular is the patch's.
    inside_share, outside_share : of the patch's area.
    histories : (B,) photons walked.
    measured : the table that belongs to the body site, or None.
    seconds : by stage.
    """

    name: str
    wavelength_nm: np.ndarray
    patch: Reflectance
    histories: np.ndarray
    inside: Reflectance | None = None
    outside: Reflectance | None = None
    difference: Reflectance | None = None
    inside_share: float | None = None
    outside_share: float | None = None
    measured: MeasuredSkin | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def stderr_relative_mean(self) -> float:
        """Relative standard error of the patch's reflectance, mean over the bands that reflect at all."""
        lit = self.patch.total > 0
        return float((self.patch.total_stderr[lit] / self.patch.total[lit]).mean()) if lit.any() else float("nan")

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender spectrum --json`` prints."""
        told = {"wavelength_nm": self.wavelength_nm.tolist(), **self.patch.as_json()}
        if self.inside is not None:
            told["regions"] = {
                "inside": {"area_share": self.inside_share, **self.inside.as_json()},
                "outside": {"area_share": self.outside_share, **self.outside.as_json()},
                "difference": self.difference.as_json(),
            }
        return told | {
            "illuminant": "D65",
            "observer": "2",
            "geometry": "8 degrees/hemispherical; color of the reflectance with specular included",
            "stderr_relative_mean": self.stderr_relative_mean,
            "photons_emitted": int(self.histories.sum()),
            "measured": None if self.measured is None else f"{self.measured.name} ({self.measured.source})",
            "seconds": dict(self.seconds),
        }


def spectrum(
    scene: Scene,
    volume: SkinVolume | None = None,
    *,
    stderr: float = STDERR,
    seed: int | None = None,
    workers: int | None = None,
    progress: bool = False,
    clock: StageClock | None = None,
) -> SkinSpectrum:
    """Diffuse reflectance and color of a scene's skin; its camera, light and sides are not read.

    Parameters
    ----------
    scene : its patch, bands, skin or slab, relief and lesions are read.
    volume : the scene's; built if not given.
    stderr : relative standard error wanted of the patch's reflectance, mean over the bands.
    seed : of the photons; by default the scene's.
    workers : threads; the result does not depend on it.
    progress : show a bar when on a terminal.
    clock : receives the seconds of the stages ``build``, ``pilot`` and ``trace``.

    Raises
    ------
    InputError : what `build` refuses.
    """
    clock = clock or StageClock()
    with clock.stage("build"):
        volume = replace(build_volume(scene) if volume is None else volume, sides="periodic")
    regions = lesion_regions(scene)
    with clock.stage("pilot"):
        histories = settle_histories(lit_pass(volume, PILOT_SEED), stderr)
    with clock.stage("trace"):
        photon_pass = lit_pass(volume, scene.photons.seed if seed is None else seed)
        counts = count_rounds(photon_pass, histories, ROUNDS, regions=regions, workers=workers, progress=progress)
    shares = [float(region.mean()) for region in regions]
    patch, *parts = _reflectances(volume, counts, shares)
    of_lesion = dict(zip(("inside", "outside", "difference"), parts))
    return SkinSpectrum(
        scene.name, volume.wavelength_nm, patch, histories * ROUNDS,
        **of_lesion, **dict(zip(("inside_share", "outside_share"), shares)),
        measured=None if scene.skin is None else measured_at(scene.skin.site, scene.skin.tone), seconds=clock.seconds,
    )  # fmt: skip


def lit_pass(volume: SkinVolume, seed: int) -> PhotonPass:
    """The photon pass of a volume under parallel light from 8 degrees, as much in every band."""
    center = np.array([0.5 * length for length in volume.size_mm])
    irradiance = np.ones(len(volume.wavelength_nm))
    return PhotonPass(volume, CollimatedLight(flight_direction(INCIDENCE_DEG, 0.0), irradiance, None, center), seed)


def lesion_regions(scene: Scene) -> tuple[np.ndarray, ...]:
    """Columns (nx, ny) inside and outside the lesions, see `SkinSpectrum`; none where either would be empty."""
    patterns = [read_pattern(scene.path(lesion.pattern), scene.patch.columns, 1.0) for lesion in scene.lesions]
    if not patterns:
        return ()
    inside = np.any([(p > 0.5 * p.max()) & (p > 0) for p in patterns], axis=0)
    outside = np.all([p == 0 for p in patterns], axis=0)
    return (inside, outside) if inside.any() and outside.any() else ()


def _reflectances(volume: SkinVolume, counts: LightCounts, shares: list[float]) -> list[Reflectance]:
    """Of the patch; then, if there are regions, inside, outside and their difference."""
    reflected, specular = (counts.tallies[..., column] for column in (tally.REFLECTED, tally.SPECULAR))
    diffuse = [reflected - specular] + [counts.exits[..., i] / share for i, share in enumerate(shares)]
    # columns: total and diffuse of the patch, then of each region
    each = np.stack([part for d in diffuse for part in (d + specular, d)], axis=-1) / counts.histories[:, None]
    mean, covariance = controlled_mean(each, balance(volume, counts))
    whole = np.eye(mean.shape[1])
    found = [_reflectance(mean, covariance, row, volume.wavelength_nm) for row in whole[::2]]
    if shares:
        found.append(_reflectance(mean, covariance, whole[2] - whole[4], volume.wavelength_nm))
    return found


def _reflectance(mean: np.ndarray, covariance: np.ndarray, total: np.ndarray, nm: np.ndarray) -> Reflectance:
    """One of the totals among the columns of `mean` (B, K), or a difference of two, told by the weights `total` (K,).

    The column of its diffuse part is the next one; the color of a difference is the difference of the colors.
    """
    used = np.flatnonzero(total)
    weights = total[used]

    def color(of: Callable) -> tuple[np.ndarray, np.ndarray]:
        each = covariance[:, used[:, None], used]
        return propagated(lambda r: np.tensordot(of(r, nm), weights, axes=(-2, 0)), mean[:, used], each)

    def number(of: Callable) -> tuple[float, float]:
        value, stderr = color(lambda r, nm: of(r, nm)[..., None])
        return float(value[0]), float(stderr[0])

    parts = []
    for weight in (total, np.roll(total, 1)):
        parts += [mean @ weight, np.sqrt(np.einsum("bjk,j,k->b", covariance, weight, weight))]
    has_angle = used.size == 1 and shows_color(nm, band_weights("D65", nm))
    angle = number(lambda r, nm: ita_deg(lab_of_factor(r, nm))) if has_angle else None
    return Reflectance(
        *parts, SkinColor(*color(lab_of_factor), number(melanin_index), number(erythema_index), angle)
    )


def propagated(
    function: Callable[[np.ndarray], np.ndarray], values: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A smooth function of reflectances, and its standard error to first order.

    Parameters
    ----------
    function : (..., K, B) -> (..., J).
    values : (B, K), independent between bands.
    covariance : (B, K, K).

    Returns
    -------
    value, stderr : (J,).
    """
    bands, kinds = values.shape
    steps = _STEP * np.eye(kinds * bands).reshape(-1, kinds, bands)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (function(values.T + steps) - function(values.T - steps)) / (2.0 * _STEP)
        slope = slope.reshape(kinds, bands, -1)
        variance = np.einsum("kbi,bkl,lbi->i", slope, covariance, slope)
        return function(values.T), np.sqrt(np.maximum(variance, 0.0))


def _pair(value: float, stderr: float) -> dict[str, float]:
    return {"value": float(value), "stderr": float(stderr)}


def _pairs(values: np.ndarray, errors: np.ndarray) -> list[dict[str, float]]:
    return [_pair(value, error) for value, error in zip(values, errors)]
