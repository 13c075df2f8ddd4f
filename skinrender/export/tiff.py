"""The spectral picture as a float32 TIFF stack: one page a band, labeled by its wavelength, as ImageJ shows it."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import whole_file
from skinrender.errors import InputError, RunError
from skinrender.film.color import MM2_PER_M2
from skinrender.film.exr import read_exr
from skinrender.film.spectral_image import SpectralImage

_MOST_BYTES = 4_000_000_000
"""ImageJ's variant of TIFF has 32-bit offsets."""


def write_tiff(picture: Path, path: Path, pixels: tuple[int, int], pixel_mm: tuple[float, float]) -> int:
    """Write the radiance of a spectral EXR, W m^-2 sr^-1 in the band, as a stack of float32 pages; how many.

    Parameters
    ----------
    picture : an EXR of `film.exr`.
    pixels : width and height of the picture in pixels, as its camera says.
    pixel_mm : width and height of a pixel in the plane through the camera's center.

    Raises
    ------
    InputError : the picture has no spectrum, is of another camera, or is larger than ImageJ can read.
    RunError : the file cannot be written.
    """
    import tifffile

    image = read_exr(picture)
    if not isinstance(image, SpectralImage):
        raise InputError(
            "it holds no spectrum, only RGB", where=str(picture), remedy="name a picture of `skinrender render`"
        )
    height, width = image.radiance.shape[:2]
    if (width, height) != tuple(pixels):
        raise InputError(
            f"the picture has {width} x {height} pixels, the scene's camera {pixels[0]} x {pixels[1]}", where=str(picture),
            remedy=f"give the camera that made it, e.g. by --set camera.pixels=[{width},{height}]",
        )  # fmt: skip
    if image.radiance.nbytes > _MOST_BYTES:
        raise InputError(f"{image.radiance.nbytes} bytes are more than ImageJ's TIFF holds", where=str(picture))
    stack = np.ascontiguousarray(np.moveaxis(image.radiance, 2, 0) * np.float32(MM2_PER_M2))
    metadata = {
        "axes": "ZYX",
        "Labels": [f"{nm:g} nm" for nm in image.wavelength_nm],
        "unit": "mm",
        "mode": "grayscale",
        "Info": json.dumps({"unit": "W m^-2 sr^-1 in the band", "provenance": image.provenance}, sort_keys=True),
    }
    with whole_file(path) as partial:
        try:
            tifffile.imwrite(
                partial, stack, imagej=True, resolution=(1.0 / pixel_mm[0], 1.0 / pixel_mm[1]), metadata=metadata
            )
        except ValueError as error:
            raise RunError(f"cannot write {path}: {error}") from error
    return len(stack)


def read_tiff(path: Path) -> tuple[np.ndarray, list[str], dict[str, Any]]:
    """Pages (bands, h, w) of `write_tiff`'s file, their labels, and what it says of itself.

    Raises
    ------
    InputError : damaged, or not a TIFF of this program.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            told = file.imagej_metadata or {}
            if file.series[0].nbytes > path.stat().st_size:
                raise ValueError("it claims more pixels than it holds")
            return file.asarray(), list(told["Labels"]), json.loads(told["Info"])
    except (LookupError, ValueError, TypeError, OSError, struct.error, tifffile.TiffFileError) as error:
        raise InputError(f"not a TIFF of this program, or a damaged one ({error})", where=str(path)) from error
