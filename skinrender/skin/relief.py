"""The relief of the skin's surface: crossing furrows, polygons and pores, or a measured height map.

Heights are z in mm, downward, mean 0: furrows are positive. Reliefs are exactly periodic over the patch. Depth (20 to
60 um) and density (10 to 30 lines a centimeter) of the forearm's furrows lie where P. Corcuff et al., J. Soc. Cosmet.
Chem. 34 (1983), p. 186 measured them; widths, secondary lines, and the cheek's polygons and pores are assumed. Between
furrows the surface is a cushion: steep only at the furrows, a quarter of whose depth is its rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skinrender.errors import SceneError
from skinrender.skin.aging import YOUNG, Aging

SAMPLE_MM = 0.025
"""Default distance between height samples: a quarter of a furrow's width."""
_SPACING_JITTER = 0.27
_DEPTH_JITTER = 0.33
_WIDTH_JITTER = 0.15
_WANDER_MM, _WANDER_LENGTH_MM = 0.07, 1.2
"""How far furrows of all directions wander together, and over what length: cushions differ in size and shape."""
_CUSHION = 0.25
_NOISE_LENGTH_MM = 0.03


@dataclass(frozen=True)
class FurrowFamily:
    """Roughly parallel V-shaped furrows.

    Parameters
    ----------
    angle_deg : of the furrows to the x axis, towards y.
    spacing_mm, depth_um, width_um : means; each furrow varies along and against its neighbors.
    """

    angle_deg: float
    spacing_mm: float
    depth_um: float
    width_um: float


FOREARM = (
    FurrowFamily(35, 0.45, 45, 100),
    FurrowFamily(-35, 0.45, 45, 100),
    FurrowFamily(80, 0.15, 12, 50),
    FurrowFamily(-10, 0.15, 12, 50),
)
NOISE_UM = 2.0


def aged_families(families: Sequence[FurrowFamily], aging: Aging) -> tuple[FurrowFamily, ...]:
    """Crossing families at an age; the first and every second one after it keep their depth under anisotropy."""
    return tuple(
        replace(
            family,
            spacing_mm=family.spacing_mm * aging.spacing,
            depth_um=family.depth_um * aging.depth * (1 - aging.anisotropy if k % 2 else 1),
            width_um=family.width_um * aging.depth,
        )
        for k, family in enumerate(families)
    )


def default_samples(size_mm: tuple[float, float]) -> tuple[int, int]:
    """Number of height samples (hx, hy) of a patch, no fewer than 4 a side."""
    return tuple(max(4, round(length / SAMPLE_MM)) for length in size_mm)


def furrowed(
    families: Sequence[FurrowFamily], size_mm: tuple[float, float], samples: tuple[int, int],
    noise_um: float = NOISE_UM, seed: int = 1,
) -> np.ndarray:  # fmt: skip
    """Height samples (hx, hy), mm, of crossing families of furrows; where furrows cross the deeper one wins."""
    rng = np.random.default_rng([seed, 1])
    lengths = (_WANDER_LENGTH_MM, _WANDER_LENGTH_MM)
    wander_mm = [_WANDER_MM * periodic_noise(size_mm, samples, lengths, 0, rng) for _ in range(2)]
    depth_um = np.zeros(samples)
    for family in families:
        np.maximum(depth_um, _family_depth_um(family, size_mm, samples, wander_mm, rng), out=depth_um)
    return _finished(depth_um, size_mm, noise_um, rng)


def polygonal(
    size_mm: tuple[float, float], samples: tuple[int, int], noise_um: float = NOISE_UM, seed: int = 1,
    aging: Aging = YOUNG, spacing_mm: float = 0.35, depth_um: float = 30, width_um: float = 100,
    pores_per_mm2: float = 1, pore_width_um: float = 150, pore_depth_um: float = 80,
) -> np.ndarray:  # fmt: skip
    """Height samples (hx, hy), mm, of a cheek: furrows along the borders of irregular cells, and pores.

    An anisotropy a makes cells longer along x than along y, by 1/(1 - a). Pores do not age.
    """
    rng = np.random.default_rng([seed, 2])
    spacing_mm, depth_um, width_um = spacing_mm * aging.spacing, depth_um * aging.depth, width_um * aging.depth
    stretch = (1 - aging.anisotropy) ** -0.5
    _, border_mm = _nearest_of_jittered_grid(size_mm, samples, spacing_mm, rng, stretch)
    depth = _furrow_um(border_mm, samples, size_mm, depth_um, width_um, spacing_mm, (spacing_mm, spacing_mm), 0, rng)
    pore_mm, _ = _nearest_of_jittered_grid(size_mm, samples, pores_per_mm2**-0.5, rng)
    bowl = np.clip(1 - (2e3 * pore_mm / pore_width_um) ** 2, 0, None) ** 2
    strength = 1 + _DEPTH_JITTER * periodic_noise(size_mm, samples, (1.0, 1.0), 0, rng)
    depth = np.maximum(depth, pore_depth_um * bowl * np.clip(strength, 0.5, 1.3))
    return _finished(depth, size_mm, noise_um, rng)


def height_map(heights_um: np.ndarray, samples: tuple[int, int]) -> np.ndarray:
    """Height samples (hx, hy), mm, from a measured map of heights in um, up positive, indexed [ix, iy].

    The map covers the patch; it is resampled by a periodic triangle filter as wide as the coarser of both grids.
    """
    weights_x = _triangle_weights(heights_um.shape[0], samples[0])
    weights_y = _triangle_weights(heights_um.shape[1], samples[1])
    surface = -1e-3 * (weights_x @ np.asarray(heights_um, float) @ weights_y.T)
    return surface - surface.mean()


def periodic_noise(
    size_mm: tuple[float, float], samples: tuple[int, int], length_mm: tuple[float, float], angle_deg: float,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Periodic Gaussian noise (hx, hy) of mean 0 and variance 1.

    Parameters
    ----------
    length_mm, angle_deg : correlation lengths along and across the direction that lies at this angle to x.
    """
    kx, ky = _wave_vectors(size_mm, samples)
    angle = np.deg2rad(angle_deg)
    along = (kx * np.cos(angle) + ky * np.sin(angle)) * length_mm[0]
    across = (-kx * np.sin(angle) + ky * np.cos(angle)) * length_mm[1]
    return shaped_noise(np.exp(-0.25 * (along**2 + across**2)), samples, rng)


def shaped_noise(amplitude: np.ndarray, samples: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Periodic noise (hx, hy) whose spectrum has the shape of ``amplitude`` (as of rfft2); mean 0, variance 1."""
    spectrum = np.fft.rfft2(rng.standard_normal(samples)) * amplitude
    spectrum[0, 0] = 0
    noise = np.fft.irfft2(spectrum, s=samples)
    deviation = noise.std()
    return noise / deviation if deviation > 0 else noise


def _wave_vectors(size_mm: tuple[float, float], samples: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    kx = 2 * np.pi * np.fft.fftfreq(samples[0], size_mm[0] / samples[0])
    ky = 2 * np.pi * np.fft.rfftfreq(samples[1], size_mm[1] / samples[1])
    return kx[:, None], ky[None, :]


def _family_depth_um(
    family: FurrowFamily, size_mm: tuple[float, float], samples: tuple[int, int], wander_mm: Sequence[np.ndarray],
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Depth of one family. Its phase rises by one a furrow and by whole numbers over the patch: hence the period."""
    angle = np.deg2rad(family.angle_deg)
    per_patch = -np.sin(angle) * size_mm[0], np.cos(angle) * size_mm[1]
    turns = [round(length / family.spacing_mm) for length in per_patch]
    if turns == [0, 0]:
        raise SceneError(
            f"furrows {family.spacing_mm:g} mm apart do not fit on a patch of {size_mm[0]:g} x {size_mm[1]:g} mm",
            key=("relief", "families"),
            remedy="Use a smaller spacing_mm or a larger patch.",
        )
    x, y = ((np.arange(n) + 0.5) / n for n in samples)
    lengths = (3 * family.spacing_mm, 0.8 * family.spacing_mm)
    warp = 0.9 * _SPACING_JITTER * periodic_noise(size_mm, samples, lengths, family.angle_deg, rng)
    warp += turns[0] / size_mm[0] * wander_mm[0] + turns[1] / size_mm[1] * wander_mm[1]
    phase = turns[0] * x[:, None] + turns[1] * y + warp
    slope = np.hypot(
        turns[0] / size_mm[0] + _slope(warp, 0, size_mm),
        turns[1] / size_mm[1] + _slope(warp, 1, size_mm),
    )
    distance_mm = np.abs(phase - np.round(phase)) / np.maximum(slope, 0.3 / family.spacing_mm)
    shape = family.depth_um, family.width_um, family.spacing_mm
    lengths = (1.5 * family.spacing_mm, 0.8 * family.spacing_mm)
    return _furrow_um(distance_mm, samples, size_mm, *shape, lengths, family.angle_deg, rng)


def _slope(field: np.ndarray, axis: int, size_mm: tuple[float, float]) -> np.ndarray:
    step = size_mm[axis] / field.shape[axis]
    return (np.roll(field, -1, axis) - np.roll(field, 1, axis)) / (2 * step)


def _furrow_um(distance_mm, samples, size_mm, depth_um, width_um, spacing_mm, lengths, angle_deg, rng) -> np.ndarray:
    """Depth at a distance from furrows whose depth and width wander: a V between rounded cushions."""
    depth = depth_um * (1 + _DEPTH_JITTER * periodic_noise(size_mm, samples, lengths, angle_deg, rng))
    width = 1e-3 * width_um * (1 + _WIDTH_JITTER * periodic_noise(size_mm, samples, lengths, angle_deg, rng))
    valley = np.clip(1 - 2 * distance_mm / np.clip(width, 0.3e-3 * width_um, None), 0, 1)
    cushion = np.clip(1 - 2 * distance_mm / spacing_mm, 0, 1) ** 2
    return np.clip(depth, 0.15 * depth_um, 2 * depth_um) * ((1 - _CUSHION) * valley + _CUSHION * cushion)


def _nearest_of_jittered_grid(size_mm, samples, spacing_mm, rng, stretch=1.0) -> tuple[np.ndarray, np.ndarray]:
    """Distance (hx, hy) to the nearest of irregular points, one in each cell of a grid, and to the border that it
    shares with the next nearest (S. Worley, A cellular texture basis function, SIGGRAPH 1996), mm.

    stretch: x is divided and y multiplied by it before nearness is judged; distances to borders are those of the
    plane."""
    scale = np.array([1 / stretch, stretch])[:, None, None]
    cells = [max(1, round(length * s / spacing_mm)) for length, s in zip(size_mm, scale.flat)]
    pitch = [length / count for length, count in zip(size_mm, cells)]
    jitter = rng.uniform(0.05, 0.95, (*cells, 2))
    x, y = ((np.arange(n) + 0.5) * (count / n) for n, count in zip(samples, cells))

    def to_point(dx: int, dy: int) -> np.ndarray:
        column, row = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
        inside = jitter[np.ix_(column % cells[0], row % cells[1])]
        across = np.stack([(column - x)[:, None] + inside[..., 0], (row - y) + inside[..., 1]])
        return across * (np.reshape(pitch, (2, 1, 1)) * scale)

    offsets = [(dx, dy) for dx in range(-2, 3) for dy in range(-2, 3)]
    nearest, nearest_sq = np.zeros((2, *samples)), np.full(samples, np.inf)
    for offset in offsets:
        point = to_point(*offset)
        square = (point**2).sum(0)
        closer = square < nearest_sq
        nearest, nearest_sq = np.where(closer, point, nearest), np.where(closer, square, nearest_sq)
    border = np.full(samples, np.inf)
    for offset in offsets:
        point = to_point(*offset)
        apart = np.sqrt(((scale * (point - nearest)) ** 2).sum(0))
        other = apart > 1e-9
        distance = ((point**2).sum(0) - nearest_sq) / (2 * np.where(other, apart, 1))
        border = np.where(other, np.minimum(border, distance), border)
    return np.sqrt(nearest_sq), border


def _triangle_weights(count_in: int, count_out: int) -> np.ndarray:
    """Rows of a periodic resampling matrix (count_out, count_in) between cell centers."""
    at = (np.arange(count_out)[:, None] + 0.5) * (count_in / count_out) - 0.5 - np.arange(count_in)
    distance = np.abs((at + count_in / 2) % count_in - count_in / 2)
    weights = np.clip(1 - distance / max(1.0, count_in / count_out), 0, None)
    return weights / weights.sum(1, keepdims=True)


def _finished(depth_um: np.ndarray, size_mm, noise_um: float, rng: np.random.Generator) -> np.ndarray:
    if noise_um:
        lengths = (_NOISE_LENGTH_MM, _NOISE_LENGTH_MM)
        depth_um = depth_um + noise_um * periodic_noise(size_mm, depth_um.shape, lengths, 0, rng)
    return 1e-3 * (depth_um - depth_um.mean())
