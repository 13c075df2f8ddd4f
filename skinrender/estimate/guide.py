"""What is known of the light's pattern without any photon, to undo what the kernel flattens.

Under a furrow the light changes within a tenth of a millimeter, as the lamp's light falls slantwise on its walls and less
is scattered towards its bottom: a kernel 0.4 mm wide made the dark wall of a furrow 60 um deep 28 % too bright and the
bright one 12 % too dark. The light that enters the surface, the same blurred and its slope (light goes on aside below the
surface), and the height are known for every pixel. Call them guides g_k, F the kernel as a filter. The filtered picture
L is multiplied by

    M = 1 + sum_k beta_k m_k,    m_k = g_k - F(g_k)

and the unfiltered picture N, noisy but not flattened, gives the few numbers beta_k by least squares over all pixels,
sum m_j (N - L) = sum_k beta_k sum L m_j m_k. Noise alone moves no mean, as the right side is linear in the photons.

The shape of the spectra has a kernel three times as wide, which flattens even whole lesions. Each band's picture gets an M
of its own, from guides that tell more of a lesion: what it lets through, weakly and strongly (bands differ in what they see
of it), blurred up to the kernel's width, and besides m_k also F(g_k), so that a lesion's mean is that of its photons. The
relief's guides stay out: bands share its shading, and on a patch of 2 mm they took the noise of color from 1.2 to 2.6.

Towards a side by which light leaves it falls within some tenths of a millimeter, and a kernel there reaches only inwards:
the outermost 25 um of an open patch of 1 mm were 66 % too bright. The distance to the sides tells three guides.

Fitting known features to a noisy picture is first-order regression (Bitterli et al., "Nonlinearly Weighted First-order
Regression for Denoising Monte Carlo Renderings", CGF 35(4), 2016), here with one fit for the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

BLURS_MM = (0.04, 0.08)
"""Standard deviations of the blurred guides; the widest kernel's is 0.14."""
COLOR_BLURS_MM = (0.04, 0.08, 0.16, 0.32)
"""The same for a lesion's in the shape of the spectra, whose kernel's is 0.42."""
SIDE_REACHES_MM = (0.05, 0.15, 0.45)
"""How far from a side the guides of the sides reach."""
COLOR_POWERS = (0.5, 2.0)
"""Powers of a lesion's transmittance that are guides of the shape of the spectra."""
_LEAST = 1e-4
"""Eigenvalue, relative to the largest, from which a combination of guides counts as known."""
_MOST = 0.9
"""Largest |M - 1|: light stays positive."""


_OF_RELIEF, _OF_LESION, _OF_SIDES = 8, 5, len(SIDE_REACHES_MM)
"""Most guides of the luminance: three of the height and five of the lamp's light; those of a lesion; of the sides."""
_OF_COLOR = len(COLOR_POWERS) * (len(COLOR_BLURS_MM) + 1)


def guide_bytes(pixels: int) -> int:
    """Most that guides, what the kernels take from them, and the normal equations of one picture hold."""
    changes = _OF_SIDES + max(_OF_RELIEF + _OF_LESION, _OF_COLOR + len(COLOR_POWERS))
    guides = _OF_RELIEF + _OF_LESION + _OF_SIDES + _OF_COLOR
    return pixels * (4 * (guides + 2 * changes) + 3 * 8 * changes)


class Guides(NamedTuple):
    """Guides of a picture, (h, w) each.

    Parameters
    ----------
    relief : of the height and of the lamp's light, for the luminance.
    lesion : of what lesions let through, for the luminance.
    color : powers of what lesions let through, each as it is and blurred, for the shape of the spectra.
    sides : how near the sides by which light leaves are, for both.
    """

    relief: Sequence[np.ndarray]
    lesion: Sequence[np.ndarray]
    color: Sequence[Sequence[np.ndarray]]
    sides: Sequence[np.ndarray]

    def of_luminance(self, filtered: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """The m_k of the luminance, filtered by its kernel."""
        return modulations([*self.relief, *self.lesion, *self.sides], filtered)

    def of_color(self, filtered: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """The m_k of one band's picture, filtered by the kernel of the spectra's shape."""
        flat = [filtered(light[0]) for light in self.color]
        guides = [guide for light in self.color for guide in light]
        return np.array([*modulations([*guides, *self.sides], filtered), *flat])


def patterns(lights: Sequence[np.ndarray], height: np.ndarray | None, spacing_mm: float, wrap: bool) -> np.ndarray:
    """Guides of a picture, (K, h, w): lights in units of their means, height in mm, each also blurred.

    Parameters
    ----------
    lights : (h, w) each, known patterns of the light that enters.
    height : (h, w) mm of the surface; None where it is flat.
    spacing_mm : of pixels; wrap: the picture repeats.
    """
    from scipy.ndimage import gaussian_filter  # takes 0.4 s, which pass beside the walk where guides are made there

    mode = "wrap" if wrap else "nearest"
    sigmas = [blur / spacing_mm for blur in BLURS_MM]
    found = []
    if height is not None:
        found += [height, *(gaussian_filter(height, sigma, mode=mode) for sigma in sigmas)]
    for light in (light / light.mean() for light in lights if light.any()):
        found += [light, *(gaussian_filter(light, sigma, mode=mode) for sigma in sigmas)]
        found += [gaussian_filter(light, sigmas[0], order, mode=mode) for order in ((0, 1), (1, 0))]
    return np.array(found, np.float32)


def color_patterns(lights: Sequence[np.ndarray], spacing_mm: float, wrap: bool) -> list[list[np.ndarray]]:
    """Guides of the shape of the spectra, for each power of each light (h, w): as it is, and blurred."""
    from scipy.ndimage import gaussian_filter

    mode = "wrap" if wrap else "nearest"
    powers = (light**power for light in lights for power in COLOR_POWERS)
    scaled = [(light / light.mean()).astype(np.float32) for light in powers]
    return [[light, *(gaussian_filter(light, blur / spacing_mm, mode=mode) for blur in COLOR_BLURS_MM)] for light in scaled]


def side_patterns(point: np.ndarray, size_mm: tuple[float, float], shape: tuple[int, int]) -> np.ndarray:
    """Guides of the sides by which light leaves, (K, h, w): sums over the four of exp(-distance / reach).

    point (h w, 2) : where the pixels' rays enter, mm.
    """
    size = np.array(size_mm)
    distance = np.clip(np.concatenate([point[:, :2], size - point[:, :2]], axis=1), 0.0, None)
    near = [np.exp(-distance / reach).sum(axis=1).reshape(shape) for reach in SIDE_REACHES_MM]
    return np.array(near, np.float32)


class Flattened(NamedTuple):
    """What it takes to undo what the kernel flattens.

    Parameters
    ----------
    noisy : (h, w, n) luminance of each band, unfiltered.
    batch_noisy : (batches, h, w) f4, what each batch adds to it, all bands.
    changes : (K, h, w) the m_k.
    """

    noisy: np.ndarray
    batch_noisy: np.ndarray
    changes: np.ndarray


def modulations(guides: Sequence[np.ndarray], filtered: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """What the kernel takes from each guide, the m_k, (K, h, w)."""
    return np.array([guide - filtered(guide) for guide in guides])


@dataclass(frozen=True, eq=False)
class Restoration:
    """The factor M of a picture, and what it makes of the photons of one batch.

    Parameters
    ----------
    plain, factor : (h, w) filtered picture and M.
    m : (K + 1, h w) a constant and the m_k, scaled alike; inverse: (K + 1, K + 1) of the normal equations.
    """

    plain: np.ndarray
    factor: np.ndarray
    m: np.ndarray
    inverse: np.ndarray

    def batch(self, plain: np.ndarray, noisy: np.ndarray) -> np.ndarray:
        """Picture (h, w) of a batch whose photons would show `plain` and `noisy`: to first order, with its noise in beta."""
        more = self.inverse @ _along(self.m, (noisy - plain * self.factor).ravel())
        return plain * self.factor + self.plain * _combined(more, self.m).reshape(self.plain.shape)


def restore(plain: np.ndarray, noisy: np.ndarray, changes: np.ndarray) -> Restoration:
    """Fit the betas. A constant beside the m_k keeps the mean of the unfiltered picture.

    Parameters
    ----------
    plain, noisy : (h, w) filtered and unfiltered picture.
    changes : (K, h, w) the m_k.
    """
    m = np.concatenate([np.ones((1, plain.size)), changes.reshape(len(changes), -1)])
    scale = np.sqrt((m * m).mean(axis=1))
    m = m[scale > 1e-9] / scale[scale > 1e-9, None]
    value, vector = np.linalg.eigh(np.einsum("jp,kp->jk", m * plain.ravel(), m))
    known = value > _LEAST * value.max()
    inverse = (vector[:, known] / value[known]) @ vector[:, known].T
    beta = inverse @ _along(m, (noisy - plain).ravel())
    factor = 1.0 + np.clip(_combined(beta, m), -_MOST, _MOST).reshape(plain.shape)
    return Restoration(plain, factor, m, inverse)


def _along(m: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Sum over pixels of each m_k times a picture; by one thread, which is faster than BLAS's where others are busy."""
    return np.einsum("kp,p->k", m, picture)


def _combined(beta: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Sum over k of beta_k m_k."""
    return np.einsum("k,kp->p", beta, m)
