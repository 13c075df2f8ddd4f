"""8-bit sRGB pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinrender.atomic import whole_file
from skinrender.film.color import encode_srgb


def write_png(path: str | Path, rgb: np.ndarray) -> float:
    """Write linear sRGB as an 8-bit PNG, whole or not at all.

    Parameters
    ----------
    path : a ``.png``; one that is there is replaced.
    rgb : (h, w, 3), 1 for white, e.g. `SpectralImage.display_rgb`.

    Returns
    -------
    float : the fraction of pixels clipped because they are brighter than white or outside the gamut; to be told.

    Raises
    ------
    RunError : the file cannot be written.
    """
    from skimage.io import imsave

    encoded, clipped = encode_srgb(rgb)
    with whole_file(path) as temporary:
        imsave(temporary, encoded, check_contrast=False)
    return clipped
