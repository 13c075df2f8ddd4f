"""What a scene uses and what is left out, each with the reason: asked of the very functions that decide it in a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from skinrender.engine.crew import WORTH_A_POOL, is_worth_a_pool
from skinrender.engine.rounds import uniform_share
from skinrender.engine.view import (
    surface_subpixels,
    transmittance_subpixels,
    why_no_picture,
    why_no_reflection,
)
from skinrender.estimate.radius import ALIKE, WIDEST_MM, is_alike, lesion_absorbance
from skinrender.estimate.ray_paths import VISIBLE_DEPTH, visible_depth_mm
from skinrender.estimate.view_path import dispersion_mm
from skinrender.photonmap.first_scattering import why_no_single_term
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.builder import index_steps, why_matched
from skinrender.skin.heights import wave_height_um
from skinrender.skin.regions import regions_of
from skinrender.skin.volume import SkinVolume


@dataclass(frozen=True)
class Feature:
    """A part of the program that a scene may need.

    Parameters
    ----------
    feature : its name.
    used : whether the scene needs it.
    reason : why it is used or left out.
    """

    feature: str
    used: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Planned:
    """A scene as far as it is known before a run.

    Parameters
    ----------
    scene, volume, photon_pass : described, built and prepared.
    stored_share : photons stored per scattering event, measured.
    stored_wanted : photons.
    workers : number of processes if somebody said it.
    """

    scene: Any
    volume: SkinVolume
    photon_pass: PhotonPass
    stored_share: float
    stored_wanted: int
    workers: int | None = None


def features_of(planned: Planned) -> list[Feature]:
    """All features, in the order of the stages."""
    return [decide(planned) for decide in _DECISIONS]


def _unless(name: str, why_not: str | None, why: str) -> Feature:
    return Feature(name, why_not is None, why if why_not is None else why_not)


def _melanin_grid(p: Planned) -> Feature:
    lesions, kinds = len(p.scene.lesions), len(p.volume.palette_layer) - 1
    why = f"{lesions} lesions make {kinds} different contents of voxels"
    return _unless("lesion melanin grid", None if lesions else "no lesions: every column of a layer is alike", why)


def _ink(p: Planned) -> Feature:
    inks = ", ".join(p.volume.ink_name)
    return _unless("tattoo ink", None if inks else "no tattoo: the palette holds melanin alone", f"volume fractions of {inks}")


def _relief(p: Planned) -> Feature:
    if not p.volume.has_relief:
        return Feature("relief height field", False, "the surface is a plane")
    surface, (hx, hy) = p.volume.surface_mm, p.volume.surface_mm.shape
    return Feature("relief height field", True, f"{hx} x {hy} heights over {1000 * np.ptp(surface):.0f} um")


def _border_wave(p: Planned) -> Feature:
    height_um = wave_height_um(p.scene)
    flat = "slabs have none" if p.scene.skin is None else "its height is 0"
    return _unless("border wave", None if height_um else flat, f"{height_um:g} um between epidermis and dermis")


def _inner_fresnel(p: Planned) -> Feature:
    why_not = why_matched(p.scene, p.volume.is_flat)
    if why_not is None and not index_steps(p.volume.refractive_index[1:]):
        why_not = "all layers have one index"
    return _unless("inner-border Fresnel", why_not, f"{len(p.volume.fresnel_borders)} borders at which the index steps")


def _surface_fresnel(p: Planned) -> Feature:
    index = regions_of(p.volume).index
    if not regions_of(p.volume).surface_refracts:
        return Feature("surface Fresnel", False, "the index is the same on both sides of the surface")
    return Feature("surface Fresnel", True, f"index {index[0].mean():.4g} outside, {index[1].mean():.4g} below")


def _dispersion(p: Planned) -> Feature:
    if not regions_of(p.volume).disperses:
        return Feature("dispersion", False, "no index depends on the wavelength")
    pixel_mm = min(p.volume.size_mm[0] / p.scene.camera.pixels[0], p.volume.size_mm[1] / p.scene.camera.pixels[1])
    off = dispersion_mm(p.volume, p.scene.camera.zenith_deg, visible_depth_mm(p.volume)) / pixel_mm
    why = f"Fresnel factors are those of each band; view rays are bent as at 550 nm, mid-picture {off:.2g} pixels off"
    return Feature("dispersion", True, why)


def _periodic(p: Planned) -> Feature:
    why = "the patch goes on at its opposite side" if p.volume.sides == "periodic" else f"sides is {p.volume.sides}"
    return Feature("periodic sides", p.volume.sides == "periodic", why)


def _bands(p: Planned) -> Feature:
    walked, bands = int(np.count_nonzero(uniform_share(p.photon_pass.power_per_band_aimed))), p.photon_pass.bands
    told = f"{walked} of {bands} bands carry light and are walked"
    return Feature("spectrum", walked > 1, told if bands > 1 else "one band")


def _float64(p: Planned) -> Feature:
    stiff = [reason for band in range(p.photon_pass.bands) if (reason := p.photon_pass.stiffness(band)) is not None]
    why_not = None if stiff else "float32 resolves every plane and free path"
    return _unless("float64 blocks", why_not, f"{len(stiff)} of {p.photon_pass.bands} bands: {(stiff or [''])[0]}")


def _single_term(p: Planned) -> Feature:
    why_not = why_no_single_term(p.volume, p.photon_pass.light)
    stored = f"first scatterings are stored as photons: {why_not}"
    return _unless("single-scattering term", why_not and stored, "first scatterings are computed, not stored")


def _roulette(p: Planned) -> Feature:
    kept = f"{100 * p.stored_share:.3g} % of the scattering events are stored"
    if p.photon_pass.depth_table.keep_probability is not None:
        return Feature("roulette on storage", True, f"{kept}, few of those that hardly show")
    why = "photons.roulette is false" if not p.scene.photons.roulette else "no photon lies too deep to show"
    return Feature("roulette on storage", False, f"{why}; {kept}")


def _worker_processes(p: Planned) -> Feature:
    if p.workers is not None:
        return Feature("worker processes", p.workers > 1, f"{p.workers} asked for")
    pool = is_worth_a_pool(p.stored_wanted)
    return Feature(
        "worker processes", pool, f"{p.stored_wanted:.3g} photons, {'at least' if pool else 'fewer than'} {WORTH_A_POOL:.0e}"
    )


def _picture(p: Planned) -> Feature:
    why = f"{' x '.join(map(str, p.scene.camera.pixels))} pixels by the {p.scene.estimate.method} estimate"
    return _unless("picture", why_no_picture(p.volume), why)


def _depth_limit(p: Planned) -> Feature:
    visible, bottom = visible_depth_mm(p.volume), float(p.volume.z_edges_mm[-1])
    if visible >= bottom * (1 - 1e-9):
        return Feature("depth limit", False, f"light shows from all {bottom:.3g} mm, within {VISIBLE_DEPTH:g} optical depths")
    return Feature("depth limit", True, f"nothing is looked for below {visible:.3g} of {bottom:.3g} mm")


def _kernel_bound(p: Planned) -> Feature:
    if p.scene.estimate.method != "beam":
        return Feature("kernel radius bound", False, f"the {p.scene.estimate.method} estimate has one radius a depth")
    absorbance = lesion_absorbance(p.volume, WIDEST_MM)
    told = f"absorbance that lesions add differs by {np.ptp(absorbance):.2g} between columns"
    if is_alike(absorbance):
        return Feature("kernel radius bound", False, f"{told}: alike, as it is not above {ALIKE:g}")
    return Feature("kernel radius bound", True, f"{told}, more than {ALIKE:g}")


def _reflection(p: Planned) -> Feature:
    why = f"microfacets of roughness {p.scene.finish.roughness:g}"
    return _unless("surface reflection", why_no_reflection(p.scene, p.volume), why)


def _subpixel_rays(p: Planned) -> Feature:
    inside = transmittance_subpixels(p.volume)
    surface = surface_subpixels(p.scene, p.volume) if why_no_reflection(p.scene, p.volume) is None else 0
    used = max(surface, inside) > 1
    why = f"{surface**2} rays a pixel for the surface, {inside**2} for the light from inside"
    return Feature("subpixel rays", used, why if used else "one ray a pixel is enough for a plane")


_DECISIONS = (
    _melanin_grid, _ink, _relief, _border_wave, _periodic, _inner_fresnel, _surface_fresnel, _dispersion,
    _bands, _float64, _single_term, _roulette, _worker_processes,
    _picture, _depth_limit, _kernel_bound, _reflection, _subpixel_rays,
)  # fmt: skip
