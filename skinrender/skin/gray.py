"""Gray images from disk: patterns and height maps."""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np

from skinrender.errors import InputError
from skinrender.files import refuse_special

_DAMAGED = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error, LookupError, MemoryError)
"""What Pillow raises for a damaged image."""


def read_gray(
    path: str | Path, formats: tuple[str, ...], *, pixels: tuple[int, int] | None = None, max_pixels: int = 1 << 26
) -> np.ndarray:
    """Read an image as gray values indexed [column, row] = [ix, iy], 0 (black) to 1 (white).

    Color becomes luma (Rec. 601), transparency shows white paper. The size is read from the header before anything is
    decoded.

    Parameters
    ----------
    path : image file.
    formats : Pillow's names of the formats to accept, e.g. ("PNG", "TIFF").
    pixels : (width, height) that the image must have.
    max_pixels : refuse larger images.

    Raises
    ------
    InputError : no such file, another format, another size than ``pixels``, damaged.
    """
    from PIL import Image  # only scenes with a pattern or a height map need it

    path, names = Path(path), " or ".join(formats)
    refuse_special(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # _check_size refuses it
            image = Image.open(path, formats=formats)
    except FileNotFoundError as error:
        raise InputError("there is no such image", where=str(path), remedy="Paths are relative to the scene.") from error
    except (*_DAMAGED, Image.DecompressionBombError) as error:
        raise InputError("this is not a readable image", where=str(path), remedy=f"Use a {names} file.") from error
    with image:
        _check_size(path, image.size, pixels, max_pixels)
        try:
            return _to_unit(image)
        except _DAMAGED as error:
            raise InputError(f"the image is damaged ({error})", where=str(path), remedy="Save it again.") from error


def _check_size(path: Path, size: tuple[int, int], pixels: tuple[int, int] | None, max_pixels: int) -> None:
    width, height = size
    if pixels and size != tuple(pixels):
        raise InputError(
            f"the image has {width} x {height} pixels, the volume has {pixels[0]} x {pixels[1]} columns",
            where=str(path),
            remedy="Resize the image, or set patch.columns to its size: one pixel is one column of voxels.",
        )
    if width * height > max_pixels:
        raise InputError(f"the image has {width} x {height} pixels, more than {max_pixels}", where=str(path))


def _to_unit(image) -> np.ndarray:
    """Gray values 0 to 1, indexed [column, row]."""
    from PIL import Image

    if image.mode.startswith("I;16"):
        values = np.asarray(image, np.float64) / 65535
    elif image.mode in ("I", "F"):
        raise ValueError("32-bit pixels have no agreed white; use 8 or 16 bits")
    else:
        if image.mode in ("P", "PA", "LA", "RGBA", "La", "RGBa") or "transparency" in image.info:
            color = image.convert("RGBA")
            image = Image.alpha_composite(Image.new("RGBA", color.size, "white"), color)
        values = np.asarray(image.convert("L"), np.float64) / 255
    return np.ascontiguousarray(values.T)
