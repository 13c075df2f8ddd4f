"""The height fields of a scene: surface, wave, and every border between layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinrender.errors import InputError
from skinrender.scene import Scene, about
from skinrender.skin import border, relief
from skinrender.skin.aging import aging
from skinrender.skin.anatomy import LayerSpec, border_depths
from skinrender.skin.gray import read_gray
from skinrender.skin.memory import require_memory
from skinrender.skin.spline import control_points

MAX_MAP_VALUES = 1 << 26
MAX_RANGE_UM = 2e4
"""As that of images, -1e4 to 1e4."""
_BYTES_PER_SAMPLE = 160
"""Peak of what drawing a relief holds: about twenty arrays of float64."""
FLAT_MM = 1e-9
"""A surface that nowhere leaves its mean by more is flat."""


@dataclass(frozen=True, eq=False)
class Heights:
    """Surface and wave as control points (hx, hy) f4, mm, None where flat; at least one is not.

    Parameters
    ----------
    fold : how far the borders below follow them.
    thickening_mm (K, hx, hy) f4 : how much lower borders at the K nodes of the fold lie for the surface's slopes.
    """

    surface_mm: np.ndarray | None
    wave_mm: np.ndarray | None
    fold: border.Fold
    thickening_mm: np.ndarray | None = None

    def at(self, depth_mm: float) -> np.ndarray:
        """Control points (hx, hy) of the border at a depth, mm."""
        relief_share, wave_share = self.fold.shares(depth_mm)
        some = self.wave_mm if self.surface_mm is None else self.surface_mm
        z = np.full(some.shape, depth_mm)
        if self.surface_mm is not None:
            z += relief_share * self.surface_mm
        if self.thickening_mm is not None:
            k, part = self.fold.between(depth_mm)
            z += (1 - part) * self.thickening_mm[k] + part * self.thickening_mm[k + 1]
        if self.wave_mm is not None:
            z += wave_share * self.wave_mm
        return z

    def borders_mm(self, layers: Sequence[LayerSpec]) -> np.ndarray | None:
        """Control points (T - 1, hx, hy) f4 of the inner borders; None when there is but one layer."""
        depths = border_depths([layer.thickness_mm for layer in layers])[1:-1]
        return np.stack([self.at(depth) for depth in depths]).astype(np.float32) if depths.size else None


def scene_heights(scene: Scene, layers: Sequence[LayerSpec]) -> Heights | None:
    """The height fields of a scene; None when all is flat.

    Raises
    ------
    InputError : the height map is unusable, or the relief is deeper than the layers.
    """
    size_mm = tuple(scene.patch.size_mm)
    if scene.relief.kind == "flat" and wave_height_um(scene) == 0:
        return None
    samples = _samples(scene)
    require_memory(
        heights_bytes(samples, len(layers)),
        f"a height field of {samples[0]} x {samples[1]} samples",
        key=("patch", "size_mm") if scene.relief.kind == "height_map" else ("relief",),
        remedy="Use a smaller patch, fewer samples, or a flat relief and border_wave.",
    )
    surface = _surface(scene, samples)
    if surface is not None:
        surface = control_points(surface).astype(np.float32)
        surface = surface if np.abs(surface).max() > FLAT_MM else None
    wave = _wave(scene, layers, size_mm, samples)
    if surface is None and wave is None:
        return None
    deepest = sum(float(field.max()) for field in (surface, wave) if field is not None)
    fold = border.fold(layers, deepest)
    if surface is None:
        return Heights(surface, wave, fold)
    return Heights(surface, wave, fold, border.thickening_mm(surface, size_mm, fold))


def heights_bytes(samples: tuple[int, int], layers: int) -> int:
    """Most memory that the height fields of so many samples take while they are made."""
    return samples[0] * samples[1] * (_BYTES_PER_SAMPLE + 4 * layers)


def _samples(scene: Scene) -> tuple[int, int]:
    """Height samples of a scene: its own, or as many as the patch needs."""
    if scene.relief.kind == "procedural" and "samples" in scene.relief.model_fields_set and scene.relief.samples:
        return tuple(scene.relief.samples)
    return relief.default_samples(tuple(scene.patch.size_mm))


def _surface(scene: Scene, samples: tuple[int, int]) -> np.ndarray | None:
    described, size_mm = scene.relief, tuple(scene.patch.size_mm)
    if described.kind == "flat":
        return None
    if described.kind == "height_map":
        with about(scene, "relief", "file"):
            return relief.height_map(_read_heights_um(scene), samples)
    noise = described.noise_um, described.seed
    if described.families is not None:
        return relief.furrowed(described.families, size_mm, samples, *noise)
    age = aging(scene.skin.site, described.age_years, described.anisotropy)
    if scene.skin.site == "cheek":
        return relief.polygonal(size_mm, samples, *noise, age)
    return relief.furrowed(relief.aged_families(relief.FOREARM, age), size_mm, samples, *noise)


def _wave(
    scene: Scene, layers: Sequence[LayerSpec], size_mm: tuple[float, float], samples: tuple[int, int]
) -> np.ndarray | None:
    height_um = wave_height_um(scene)
    if height_um == 0:
        return None
    period_um = scene.skin.border_wave.period_um
    period_um = border.WAVE_PERIOD_UM if period_um is None else period_um
    wave = border.papillae(size_mm, samples, tuple(scene.patch.columns), height_um, period_um)
    return border.limit_wave(wave, layers).astype(np.float32)


def wave_height_um(scene: Scene) -> float:
    """Height of the wave between epidermis and dermis, valley to peak; 0 where there is none, as in slabs."""
    if scene.skin is None:
        return 0.0
    given = scene.skin.border_wave.peak_to_valley_um
    return border.WAVE_PEAK_TO_VALLEY_UM[scene.skin.site] if given is None else given


def _read_heights_um(scene: Scene) -> np.ndarray:
    """The scene's height map in um, up positive, indexed [ix, iy]."""
    path = scene.path(scene.relief.file)
    if path.suffix.lower() != ".npy":
        low, high = scene.relief.range_um
        return low + (high - low) * read_gray(path, ("PNG", "TIFF"), max_pixels=MAX_MAP_VALUES)
    heights = _read_npy(path)
    if not np.all(np.isfinite(heights)):
        raise InputError("the height map holds NaN or Inf", where=str(path), remedy="Fill the gaps of the measurement.")
    with np.errstate(over="ignore"):
        heights_um = scene.relief.um_per_unit * (heights.T - heights.min())
    if heights_um.max() > MAX_RANGE_UM:
        raise InputError(
            f"its heights span {heights_um.max():.3g} um, more than {MAX_RANGE_UM:g}", where=str(path),
            remedy="Use a smaller um_per_unit, or remove outliers.",
        )  # fmt: skip
    return heights_um


def _read_npy(path: Path) -> np.ndarray:
    try:
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError as error:
        raise InputError("there is no such height map", where=str(path)) from error
    except (OSError, ValueError, EOFError, SyntaxError, OverflowError) as error:
        raise InputError(
            "this is no readable .npy file", where=str(path), remedy="Save it with numpy.save(..., allow_pickle=False)."
        ) from error
    if not isinstance(mapped, np.ndarray) or mapped.ndim != 2 or mapped.dtype.kind not in "iuf":
        raise InputError("a height map is a 2-D array of numbers, [row, column]", where=str(path))
    if not 0 < mapped.size <= MAX_MAP_VALUES:
        raise InputError(f"the height map has {mapped.size} values; 1 to {MAX_MAP_VALUES} are allowed", where=str(path))
    return np.asarray(mapped, np.float64)
