"""Spectral OpenEXR files: A. Fichet, R. Pacanowski, A. Wilkie, An OpenEXR layout for spectral images, JCGT 10(3), 2021.

One part, float32, ZIP. Channels: ``S0.550,000000nm`` radiance in the band, W m^-2 sr^-1; R, G, B linear sRGB;
``surface.Y``, ``single.Y``, ``multiple.Y``, ``stderr.Y``; ``irradiance.total``, W m^-2 over all bands; on request
``T.550,000000nm``, the radiance factor. A checksum of pixels and attributes, which ZIP lacks for what it cannot shrink.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import whole_file
from skinrender.errors import InputError, RunError
from skinrender.files import refuse_special
from skinrender.film.color import MM2_PER_M2, SRGB_CHROMATICITIES
from skinrender.film.spectral_image import RgbImage, SpectralImage

_PARTS = ("surface_Y", "single_Y", "multiple_Y", "stderr_Y")
_PROVENANCE = "skinrender:provenance"
_FILM = "skinrender:film"
_IRRADIANCE = "irradiance.total"
_CHECKSUM = "skinrender:crc32"
_EMISSIVE = re.compile(r"^S0\.(\d+(?:[.,]\d+)?)nm$")
# Compressed pixels grow at most about a thousandfold; a header that claims more is damaged or hostile.
_MOST_BYTES_PER_FILE_BYTE = 4096


def exr_bytes(pixels: int, bands: int) -> int:
    """Size of the file before compression, which noise leaves little to: a channel a band, and eight more."""
    return 4 * pixels * (bands + 8)


def write_exr(path: str | Path, image: SpectralImage, *, reflectance: bool = False) -> None:
    """Write a spectral image, whole or not at all.

    Parameters
    ----------
    path : an ``.exr``; one that is there is replaced.
    image : its radiance in W mm^-2 sr^-1 becomes W m^-2 sr^-1 in the file.
    reflectance : also write the radiance factor, as ``T.`` channels.

    Raises
    ------
    RunError : the file cannot be written; nothing is left behind.
    """
    import OpenEXR

    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": SRGB_CHROMATICITIES,
        "spectralLayoutVersion": "1.0",
        "emissiveUnits": "W.m^-2.sr^-1",
        _PROVENANCE: json.dumps(image.provenance, sort_keys=True),
        _FILM: json.dumps({"exposure": float(image.exposure), "light": [float(share) for share in image.light]}),
    }
    channels = {name: np.ascontiguousarray(pixels, dtype=np.float32) for name, pixels in _channels(image, reflectance)}
    header[_CHECKSUM] = _checksum(header, channels)
    OpenEXR.set_global_thread_count(os.cpu_count() or 1)  # compressing 81 bands of 200 x 200 takes 0.3 s by one
    with whole_file(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(temporary))
        except RuntimeError as error:
            raise RunError(f"cannot write {path}: {error}") from error


def read_exr(path: str | Path) -> SpectralImage | RgbImage:
    """Read a picture of `write_exr`; of any other EXR its R, G, B (or its Y as gray).

    Parameters
    ----------
    path : the EXR; rows of the file become rows (h) of the arrays.

    Raises
    ------
    InputError : missing, not an EXR, truncated or damaged, or without any of these channels.
    """
    path = Path(path)
    header, channels = _read_channels(path)
    ours = _CHECKSUM in header or _FILM in header or _IRRADIANCE in channels
    if ours and not (_has_texts(header) and header.get(_CHECKSUM) == _checksum(header, channels)):
        raise _damaged(path, "it does not match its checksum")
    wavelengths = {name: _wavelength_nm(name) for name in channels if _EMISSIVE.match(name)}
    if wavelengths and _FILM in header:
        return _spectral_image(path, header, channels, wavelengths)
    for names in (("R", "G", "B"), ("Y", "Y", "Y")):
        if all(name in channels for name in names):
            return RgbImage(np.stack([channels[name] for name in names], axis=-1))
    raise InputError(
        f"it has neither the channels R, G, B nor Y nor the spectral ones of this program, but {_some(channels)}",
        where=str(path),
    )


def channel_names(path: str | Path) -> list[str]:
    """Names of an EXR's channels, from the header alone."""
    return [channel.name for channel in _header(Path(path))["channels"]]


def read_provenance(path: str | Path) -> dict[str, Any]:
    """Provenance of a picture of `write_exr`, from the header alone; empty for any other EXR. Raises `InputError`."""
    return _json_attribute(Path(path), _header(Path(path)), _PROVENANCE)


def _channels(image: SpectralImage, reflectance: bool):
    rgb = image.rgb()
    for index, name in enumerate("RGB"):
        yield name, rgb[..., index]
    for part in _PARTS:
        yield part.replace("_", "."), getattr(image, part)
    yield _IRRADIANCE, MM2_PER_M2 * _total_irradiance(image)
    names = [f"{nm:.6f}nm".replace(".", ",") for nm in image.wavelength_nm]
    for band, name in enumerate(names):
        yield f"S0.{name}", MM2_PER_M2 * image.radiance[..., band]
    if reflectance:
        factor = image.radiance_factor()
        for band, name in enumerate(names):
            yield f"T.{name}", factor[..., band]


def _has_texts(header: Mapping[str, Any]) -> bool:
    """Whether this program's attributes are text; of a changed type they may be something that does not even print."""
    return all(isinstance(header.get(name, ""), str) for name in (_PROVENANCE, _FILM, _CHECKSUM))


def _checksum(header: Mapping[str, Any], channels: Mapping[str, np.ndarray]) -> str:
    """CRC-32 of this program's attributes and of every channel, in hexadecimal."""
    crc = zlib.crc32(f"{header.get(_PROVENANCE)} {header.get(_FILM)}".encode())
    for name in sorted(channels):
        crc = zlib.crc32(channels[name], zlib.crc32(f"{name} {channels[name].shape}".encode(), crc))
    return f"{crc:08x}"


def _total_irradiance(image: SpectralImage) -> np.ndarray:
    """(h, w); the file keeps irradiance as total x share per band, which one light's always is."""
    total = image.irradiance.sum(axis=-1, dtype=float)
    if not np.all(total < np.finfo(np.float32).max / MM2_PER_M2):
        raise RunError("the light is stronger than a picture in float32 can hold\n  weaken it, or move the lamp away")
    if not np.allclose(image.irradiance, total[..., np.newaxis] * image.light, rtol=1e-4, atol=1e-6 * total.max()):
        raise ValueError("irradiance must have the same spectrum at every pixel")
    return total


def _spectral_image(
    path: Path, header: Mapping[str, Any], channels: Mapping[str, np.ndarray], wavelengths: Mapping[str, float]
) -> SpectralImage:
    film = _json_attribute(path, header, _FILM)
    names = sorted(wavelengths, key=wavelengths.__getitem__)
    try:
        light, exposure = np.array(film["light"], dtype=float), float(film["exposure"])
        parts = {part: channels[part.replace("_", ".")] for part in _PARTS}
        total = channels[_IRRADIANCE]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the spectral image is incomplete: {error}", where=str(path)) from error
    if light.shape != (len(names),):
        raise InputError(f"{len(names)} spectral channels but a light of {light.size} bands", where=str(path))
    return SpectralImage(
        radiance=np.stack([channels[name] for name in names], axis=-1) / np.float32(MM2_PER_M2),
        wavelength_nm=np.array([wavelengths[name] for name in names]),
        irradiance=(total[..., np.newaxis] * (light / MM2_PER_M2)).astype(np.float32),
        exposure=exposure,
        provenance=_json_attribute(path, header, _PROVENANCE),
        **parts,
    )


def _wavelength_nm(channel: str) -> float:
    return float(_EMISSIVE.match(channel).group(1).replace(",", "."))


def _json_attribute(path: Path, header: Mapping[str, Any], name: str) -> dict[str, Any]:
    try:
        content = json.loads(header.get(name, "{}"))
    except (TypeError, ValueError) as error:
        raise InputError(f"its attribute {name} is not JSON", where=str(path)) from error
    if not isinstance(content, dict):
        raise InputError(f"its attribute {name} is not a JSON object", where=str(path))
    return content


def _header(path: Path) -> Mapping[str, Any]:
    """The header, checked against the size of the file before any pixel is allocated."""
    import OpenEXR

    refuse_special(path)
    try:
        with path.open("rb") as file:
            magic = file.read(4)
        size = path.stat().st_size
    except OSError as error:
        raise InputError(
            f"cannot read the picture: {error.strerror}", where=str(path), remedy="name an EXR picture"
        ) from error
    if magic != b"\x76\x2f\x31\x01":
        raise InputError("this is not an OpenEXR file", where=str(path), remedy="name an EXR picture")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header = dict(file.header())
        low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
        values = int(np.prod(high - low + 1)) * len(header["channels"])
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        raise _damaged(path, error) from error
    if np.any(high < low) or values * 4 > size * _MOST_BYTES_PER_FILE_BYTE:
        width, height = high - low + 1
        raise InputError(f"{width} x {height} pixels cannot be in a file of {size} bytes", where=str(path))
    return header


def _read_channels(path: Path) -> tuple[Mapping[str, Any], dict[str, np.ndarray]]:
    """Header and float32 channels, all of one (h, w)."""
    header = _header(path)
    import OpenEXR

    said = io.StringIO()  # the library prints what it cannot read, where --json wants nothing but JSON
    try:
        with contextlib.redirect_stdout(said), OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, MemoryError) as error:
        raise _damaged(path, said.getvalue().strip() or error) from error
    low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
    width, height = high - low + 1
    if said.getvalue() or not channels:
        raise _damaged(path, said.getvalue().strip() or "no pixels")
    odd = [name for name, pixels in channels.items() if pixels.shape != (height, width)]
    if odd:
        raise InputError(f"subsampled channels are not supported: {_some(odd)}", where=str(path))
    return header, channels


def _damaged(path: Path, detail: object) -> InputError:
    return InputError(f"the file is truncated or damaged: {detail}", where=str(path), remedy="make it again")


def _some(names) -> str:
    names = list(names)
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
