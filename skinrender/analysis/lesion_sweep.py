"""Color of lesions against their surround, by depth and amount.

Each lesion covers a whole flat patch of forearm; its color less that of the patch without it, by `spectrum`. What pigment
does depends on where it lies: light that it takes at the top it takes at all wavelengths that it absorbs, most in the
blue (brown); deep down little but red light arrives, so that blue and green are left (paper, section 8.2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.analysis.spectrum import SkinSpectrum, spectrum
from skinrender.film.png import write_png
from skinrender.scene import Scene, make_scene
from skinrender.skin.builder import build_volume, scene_layers
from skinrender.skin.dermis import range_of_layers_mm
from skinrender.skin.volume import SkinVolume

MELANIN_UM = (0.5, 2.0, 8.0)
"""Thickness that the added melanosomes would have as a layer of their own."""
EPIDERMAL = (0.03, 0.1, 0.3)
DERMAL = {"papillary": (41, 4), "subpapillary": (33, 3), "upper plexus": (25, 3), "reticular, upper": (17, 3),
          "reticular, middle": (10, 3)}  # fmt: skip
"""center_layer and half_layers of the forearm."""
MOLES = ((0.1, 0.1), (0.1, 0.3), (0.4, 0.1), (0.4, 0.3))
"""depth_mm and melanin_scale."""
INK_TOP_MM = (0.0, 0.1, 0.3, 0.6)
INK_HEIGHT_MM = 0.3
INK = (0.0003, 0.003)
COLORED = ("red", "blue", "green")


@dataclass(frozen=True)
class Row:
    """A lesion and what it does.

    Parameters
    ----------
    kind, where : of the lesion.
    amount_um : thickness that its pigment would have as a layer of its own.
    depth_mm : mean depth of the pigment below the surface.
    lab : L*, a*, b* less those of the skin without it; lab_stderr their standard errors.
    found : its reflectance.
    """

    kind: str
    where: str
    amount_um: float
    depth_mm: float
    lab: np.ndarray
    lab_stderr: np.ndarray
    found: SkinSpectrum


def forearm(folder: Path, lesions: Sequence[Mapping[str, Any]] = (), step_nm: float = 10.0) -> Scene:
    """One column of flat forearm, wholly covered by lesions; their pattern is written into ``folder``."""
    pattern = folder / "black.png"
    if not pattern.exists():
        write_png(pattern, np.zeros((1, 1, 3)))
    return make_scene({
        "patch": {"size_mm": [10, 10], "columns": [1, 1]},
        "bands_nm": {"step": step_nm},
        "skin": {"site": "forearm", "border_wave": {"peak_to_valley_um": 0}},
        "relief": {"kind": "flat"},
        "lesions": [{"pattern": pattern.name, **lesion} for lesion in lesions],
    }, source_dir=folder)  # fmt: skip


def sweep(plain: Scene) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Where each lesion of the table lies, and its keys."""
    for scale in EPIDERMAL:
        yield "epidermis", {"kind": "epidermal", "melanin_scale": scale}
    for where, (center, half) in DERMAL.items():
        top_mm, bottom_mm = range_of_layers_mm(scene_layers(plain), center, half)
        for amount_um in MELANIN_UM:
            scale = amount_um / 1000 / (bottom_mm - top_mm)
            yield where, {"kind": "dermal", "melanin_scale": scale, "center_layer": center, "half_layers": half}
    for depth_mm, scale in MOLES:
        yield f"to {depth_mm:g} mm", {"kind": "mole", "melanin_scale": scale, "depth_mm": depth_mm}
    for top_mm in INK_TOP_MM:
        for fraction in INK:
            yield _ink_place(top_mm), _tattoo(top_mm, fraction, "carbon_black")
    for ink in COLORED:
        yield _ink_place(INK_TOP_MM[1]), _tattoo(INK_TOP_MM[1], INK[-1], ink)


def pigment_of(volume: SkinVolume, plain: SkinVolume) -> tuple[float, float]:
    """Amount (um) and mean depth (mm) of the melanin and ink that the first column of a volume holds above another's."""
    (height, moment), (own_height, own_moment) = _pigment(volume), _pigment(plain)
    amount_mm = height - own_height
    return 1000 * amount_mm, (moment - own_moment) / amount_mm


def rows(folder: Path, stderr: float) -> Iterator[Row]:
    """Walk the sweep."""
    plain = forearm(folder)
    plain_volume, surround = build_volume(plain), spectrum(plain, stderr=stderr / 2).patch.color
    for number, (where, lesion) in enumerate(sweep(plain), 2):
        scene = forearm(folder, [lesion])
        volume = build_volume(scene)
        found = spectrum(scene, volume, stderr=stderr, seed=number)
        color = found.patch.color
        yield Row(
            lesion.get("ink", lesion["kind"]), where, *pigment_of(volume, plain_volume),
            color.lab - surround.lab, np.hypot(color.lab_stderr, surround.lab_stderr), found,
        )  # fmt: skip


def _tattoo(top_mm: float, fraction: float, ink: str) -> Mapping[str, Any]:
    return {"kind": "tattoo", "volume_fraction": fraction, "ink": ink, "depth_mm": [top_mm, top_mm + INK_HEIGHT_MM]}


def _ink_place(top_mm: float) -> str:
    return f"{top_mm:g} to {top_mm + INK_HEIGHT_MM:g} mm"


def _pigment(volume: SkinVolume) -> tuple[float, float]:
    """Height (mm) and first moment (mm^2) of the pigment in the first column."""
    entry = volume.palette_index[0, 0]
    content = volume.palette_melanin[entry].astype(float)
    if volume.palette_ink is not None:
        content = content + volume.palette_ink[entry].sum(axis=1)
    z = volume.z_edges_mm
    return float(content @ np.diff(z)), float(content @ np.diff(z**2) / 2)
