"""The borders of layers as height fields: folded by the relief, waved by the papillae.

Every border is z = depth + a h(x, y) + b w(x, y) + c(x, y), with the surface h and the wave w of the dermal-epidermal
border:

- a = 1 through the epidermis, which keeps its thickness along the surface's normal (a furrow is a fold, not a cut): c
  is what `offset_mm` adds to its vertical thickness, 35 % on a wall of 42 degrees, nothing on a plateau;
- b grows from 0 to 1 through the granular and spinous layers and is 1 through the basal layer, a single row of cells
  that follows the border: the wave's room comes out of the spinous layer, as between rete ridges;
- below, all three fade linearly to 0 at the bottom of the subpapillary layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinrender.errors import SceneError
from skinrender.skin.anatomy import EPIDERMIS, LayerSpec, border_depths
from skinrender.skin.relief import shaped_noise
from skinrender.skin.spline import center_weights, control_points, evaluate_grid, weighted_sum

WAVE_PEAK_TO_VALLEY_UM = {"forearm": 40.0, "cheek": 25.0}
WAVE_PERIOD_UM = 110.0
"""84 papillae a square millimeter, counted by confocal microscopy and histology of skin."""
LEAST_VIABLE_MM = 0.020
_COLUMNS_PER_PERIOD = 2.5
_BANDWIDTH = 0.08
"""Standard deviation of the wave's frequencies over their mean."""
_WAVE_SEED = 11
_RING, _DIRECTIONS = np.deg2rad(10.0), 12
"""Of `offset_mm`: angle between the rings of a ball at most, and points on each."""
_ROOM = 1.1
"""How much higher than the largest displacement the fading stretch must be, so that no border overtakes the next."""


@dataclass(frozen=True, eq=False)
class Fold:
    """How far a border at each depth follows relief and wave.

    Parameters
    ----------
    depth_mm (K,) : nodes, ascending; relief_share, wave_share (K,) : a and b there, linear in between.
    """

    depth_mm: np.ndarray
    relief_share: np.ndarray
    wave_share: np.ndarray

    @property
    def bottom_mm(self) -> float:
        """Depth from which on all borders are flat."""
        return float(self.depth_mm[-1])

    def shares(self, depth_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """a and b at depths."""
        return (
            np.interp(depth_mm, self.depth_mm, self.relief_share, right=0.0),
            np.interp(depth_mm, self.depth_mm, self.wave_share, right=0.0),
        )

    def between(self, depth_mm: float) -> tuple[int, float]:
        """Node k above a depth, and which part of the way to node k + 1 it lies; the lowest nodes' for what is
        below."""
        k = int(np.clip(np.searchsorted(self.depth_mm, depth_mm, side="right") - 1, 0, self.depth_mm.size - 2))
        part = (depth_mm - self.depth_mm[k]) / (self.depth_mm[k + 1] - self.depth_mm[k])
        return k, float(np.clip(part, 0.0, 1.0))


def offset_mm(surface_mm: np.ndarray, size_mm: tuple[float, float], distance_mm: float) -> np.ndarray:
    """Heights (hx, hy), mm, at the cell centers of the surface that lies everywhere at a distance below another one.

    What is nearer to the air than the distance t lies above it: z(x) = max over |d| <= t of h(x + d) + sqrt(t^2 - d^2),
    a dilation by a ball (J. Serra, Image Analysis and Mathematical Morphology, 1982). On a plane of slope s that is t
    sqrt(1 + s^2) lower, at the bottom of a furrow t. The maximum is taken over the center and 12 directions on rings of
    the ball, every 10 degrees up to the surface's steepest slope: on planes at most 2 % of t are missing.

    Parameters
    ----------
    surface_mm (hx, hy) : control points of h.
    """
    cells = [count / length for count, length in zip(surface_mm.shape, size_mm)]
    reach = 2 + int(distance_mm * max(cells))
    periodic = np.pad(surface_mm.astype(float), reach, mode="wrap")
    along_x, work_x = np.empty((2, len(surface_mm), periodic.shape[1]))
    beside, work = np.empty((2, *surface_mm.shape))
    deepest = np.full(surface_mm.shape, -np.inf)
    for x, several_y, down in _ball(distance_mm, _steepest(surface_mm, size_mm)):
        first, weights = center_weights(x * cells[0])
        weighted_sum([periodic[reach + first + k :][: len(along_x)] for k in range(3)], weights, along_x, work_x)
        for y in several_y:
            first, weights = center_weights(y * cells[1])
            weighted_sum([along_x[:, reach + first + k :][:, : beside.shape[1]] for k in range(3)], weights, beside, work)
            np.maximum(deepest, np.add(beside, down, out=beside), out=deepest)
    return deepest


def _ball(radius_mm: float, steepest: float) -> list[tuple[float, list[float], float]]:
    """Points of a ball's lower side, as x with all y that go with it, and how far they lie below its center, mm."""
    rings = int(np.ceil(steepest / _RING))
    ball = [(0.0, [0.0], radius_mm)]
    for tilt in steepest * np.arange(1, rings + 1) / max(1, rings):
        away, down = radius_mm * np.sin(tilt), radius_mm * np.cos(tilt)
        for angle in 2 * np.pi * np.arange(_DIRECTIONS // 2 + 1) / _DIRECTIONS:
            y = away * np.sin(angle)
            ball.append((away * np.cos(angle), [y, -y] if 0 < angle < np.pi else [0.0], down))
    return ball


def _cell_centers(samples: tuple[int, int], size_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """x (hx,) and y (hy,), mm."""
    return tuple((np.arange(count) + 0.5) * (length / count) for count, length in zip(samples, size_mm))


def _steepest(surface_mm: np.ndarray, size_mm: tuple[float, float]) -> float:
    """Angle that no slope of a spline with these control points exceeds."""
    steps = (np.abs(surface_mm - np.roll(surface_mm, 1, axis)).max() for axis in (0, 1))
    slopes = [step * count / length for step, count, length in zip(steps, surface_mm.shape, size_mm)]
    return float(np.arctan(np.hypot(*slopes)))


def thickening_mm(surface_mm: np.ndarray, size_mm: tuple[float, float], fold: Fold) -> np.ndarray:
    """How much lower than under a plane (K, hx, hy) f4, mm, borders at the nodes of a fold lie.

    Layers of the epidermis keep their thickness along the normal; the lowest node is flat. Never less for a deeper
    border of the epidermis, so that none overtakes the next, and none lower than at the bottom of the deepest furrow.
    """
    room_mm = surface_mm.max() - surface_mm
    x, y = _cell_centers(surface_mm.shape, size_mm)
    own = evaluate_grid(surface_mm, size_mm, x, y)
    added = np.zeros((fold.depth_mm.size, *surface_mm.shape), np.float32)
    for k, depth in enumerate(fold.depth_mm[:-1]):
        if depth > 0:
            lower = offset_mm(surface_mm, size_mm, float(depth)) - own - depth
            added[k] = np.clip(lower, added[k - 1], room_mm)
    return added


def papillae(
    size_mm: tuple[float, float], samples: tuple[int, int], columns: tuple[int, int], peak_to_valley_um: float,
    period_um: float,
) -> np.ndarray:  # fmt: skip
    """Wave of the dermal-epidermal border as control points (hx, hy), mm, nowhere beyond half its height.

    A regular wave of 110 um on columns of 50 um would alias into stripes. This is band-limited noise: irregular
    papillae of random direction and phase with the given period, or with 2.5 columns where the columns cannot resolve
    it (2.5 samples where the samples cannot), so that no frequency exceeds that of the columns. Its root mean square
    is that of the sine x sine wave of the same height, a quarter of it, whatever the period: the spread of epidermal
    thickness, which sets the color of the skin, is kept.
    """
    coarsest_mm = max(length / count for axis in (columns, samples) for length, count in zip(size_mm, axis))
    period_mm = max(1e-3 * period_um, _COLUMNS_PER_PERIOD * coarsest_mm)
    fx = np.fft.fftfreq(samples[0], size_mm[0] / samples[0])[:, None]
    fy = np.fft.rfftfreq(samples[1], size_mm[1] / samples[1])
    ring = np.exp(-0.5 * ((np.hypot(fx, fy) * period_mm - 1) / _BANDWIDTH) ** 2)
    noise = shaped_noise(ring, samples, np.random.default_rng(_WAVE_SEED))
    half_mm = 0.5e-3 * peak_to_valley_um
    return np.clip(control_points(0.5 * half_mm * noise), -half_mm, half_mm)


def limit_wave(wave_mm: np.ndarray, layers: Sequence[LayerSpec]) -> np.ndarray:
    """The wave, cut where less than 20 um of viable epidermis, or a tenth of the layer it thins, would remain."""
    thickness = {layer.name: layer.thickness_mm for layer in layers}
    spinous, basal = thickness["granular_spinous"], thickness["basal"]
    return np.maximum(wave_mm, -max(0.0, min(spinous + basal - LEAST_VIABLE_MM, 0.9 * spinous)))


def fold(layers: Sequence[LayerSpec], displacement_mm: float) -> Fold:
    """The fold of a stack of layers; displacement_mm is the largest downward one, of surface and wave together.

    Layers without an epidermis (slabs) fade from the surface on. Where the subpapillary layer is too shallow for the
    displacement, the fold reaches down to the first border that is not.

    Raises
    ------
    SceneError : the relief is deeper than the layers.
    """
    names = [layer.name for layer in layers]
    bottoms = border_depths([layer.thickness_mm for layer in layers])[1:]
    epidermal = [i for i, name in enumerate(names) if name in EPIDERMIS]
    top = float(bottoms[epidermal[-1]]) if epidermal else 0.0
    first = names.index("subpapillary") if "subpapillary" in names else len(epidermal)
    fitting = [float(b) for b in bottoms[first:] if b > top and b - top >= _ROOM * displacement_mm]
    if not fitting:
        raise SceneError(
            f"the relief goes {1000 * displacement_mm:.0f} um down, the layers below it end at "
            f"{1000 * bottoms[-1]:.0f} um",
            key=("relief",),
            remedy="Use a shallower relief or thicker layers.",
        )
    if "granular_spinous" not in names or "basal" not in names:
        return Fold(np.array([0.0, top, fitting[0]]), np.array([1.0, 1.0, 0.0]), np.zeros(3))
    spinous = names.index("granular_spinous")
    nodes = [0.0, float(bottoms[spinous]) - layers[spinous].thickness_mm, float(bottoms[spinous]), top, fitting[0]]
    return Fold(np.array(nodes), np.array([1.0, 1, 1, 1, 0]), np.array([0.0, 0, 1, 1, 0]))
