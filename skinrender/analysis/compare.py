"""How far one picture is from another."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from skinrender.errors import InputError
from skinrender.film import color
from skinrender.film.spectral_image import RgbImage, SpectralImage

Picture = SpectralImage | RgbImage
_SSIM_WINDOW = 7


def compare(a: Picture, b: Picture, regions: Mapping[str, np.ndarray] | None = None) -> dict:
    """Errors of picture `a` against the reference `b`, on luminance (on the band where there is one).

    Parameters
    ----------
    a, b : pictures of the same size, as `read_exr` and `estimate` give them.
    regions : masks (h, w) by name; the errors within each appear under the key ``regions``.

    Returns
    -------
    dict : ``rmse`` = sqrt(mean (A-B)^2), ``relmse`` = mean (A-B)^2/B^2 over B > 0, ``bias`` = mean A / mean B - 1,
        ``ssim`` (data range: that of B), ``delta_e_mean`` and ``delta_e_p95`` (CIEDE2000); None where undefined:
        no pixel with B > 0, mean B = 0, or a side too short for SSIM.

    Raises
    ------
    InputError : the sizes differ, or a pixel is not finite.
    """
    y_a, y_b = _luminance(a, "A"), _luminance(b, "B")
    if y_a.shape != y_b.shape:
        raise InputError(
            f"the pictures differ in size: {_size(y_a)} and {_size(y_b)} pixels",
            remedy="render both with the same camera.pixels",
        )
    similarity, difference = _ssim_map(y_a, y_b), _delta_e(a, b)
    result = _errors(y_a, y_b, similarity, difference, np.ones(y_a.shape, dtype=bool))
    if regions is not None:
        result["regions"] = {
            name: _errors(y_a, y_b, similarity, difference, _mask(name, mask, y_a.shape))
            for name, mask in regions.items()
        }
    return result


def relative_mse(a: np.ndarray, b: np.ndarray) -> float | None:
    """mean (A-B)^2/B^2 over B > 0; None without such pixels."""
    lit = b > 0
    return float(np.mean((a[lit] / b[lit] - 1.0) ** 2)) if lit.any() else None


def _errors(y_a: np.ndarray, y_b: np.ndarray, similarity: np.ndarray, difference: np.ndarray, mask: np.ndarray) -> dict:
    a, b = y_a[mask], y_b[mask]
    mean_b = float(b.mean())
    return {
        "rmse": math.sqrt(np.mean((a - b) ** 2)),
        "relmse": relative_mse(a, b),
        "bias": float(a.mean()) / mean_b - 1.0 if mean_b else None,
        "ssim": _mean_of_known(similarity[mask]),
        "delta_e_mean": float(difference[mask].mean()),
        "delta_e_p95": float(np.percentile(difference[mask], 95)),
    }


def _mean_of_known(values: np.ndarray) -> float | None:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else None


def _luminance(image: Picture, name: str) -> np.ndarray:
    y = np.asarray(image.y(), dtype=float)
    broken = int(np.count_nonzero(~np.isfinite(y)))
    if broken:
        raise InputError(f"{broken} pixels of picture {name} are not finite")
    return y


def _ssim_map(y_a: np.ndarray, y_b: np.ndarray) -> np.ndarray:
    """Structural similarity around each pixel; nan where its window would leave the picture."""
    from skimage.metrics import structural_similarity

    similarity = np.full(y_b.shape, np.nan)
    window = min(_SSIM_WINDOW, *y_b.shape)
    window -= 1 - window % 2
    if window < 3:
        return similarity
    scale = float(np.ptp(y_b)) or float(np.abs(y_b).max()) or 1.0
    _, full = structural_similarity(y_a / scale, y_b / scale, win_size=window, data_range=1.0, full=True)
    inside = (slice(window // 2, -(window // 2)),) * 2
    similarity[inside] = full[inside]
    return similarity


def _delta_e(a: Picture, b: Picture) -> np.ndarray:
    if isinstance(a, SpectralImage) and isinstance(b, SpectralImage):
        return color.delta_e(a.lab(), b.lab())
    return color.delta_e(color.lab_of_rgb(a.rgb()), color.lab_of_rgb(b.rgb()))


def _mask(name: str, mask: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    mask = np.asarray(mask, dtype=bool)
    if mask.shape != shape:
        raise InputError(f"the mask {name!r} has {_size(mask)} pixels, the pictures {_size(np.empty(shape))}")
    if not mask.any():
        raise InputError(f"the mask {name!r} selects no pixel")
    return mask


def _size(pixels: np.ndarray) -> str:
    return " x ".join(str(n) for n in pixels.shape[::-1])
