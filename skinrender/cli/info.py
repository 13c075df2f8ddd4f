"""skinrender info: what a file is and where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinrender.cli.console import Console, Row, bytes_text
from skinrender.cli.options import reporting
from skinrender.errors import InputError

_EXR_MAGIC = b"\x76\x2f\x31\x01"
_ZIP_MAGIC = b"PK\x03\x04"


@click.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@reporting
def info(file: Path, console: Console) -> None:
    """Say what FILE (a volume, a photon map or an EXR picture) holds and where it came from.

    -v shows the whole provenance, without it what it takes to tell two files apart.

    \b
    Example:
      skinrender info out/fig12_epidermal/photons.npz
    """
    summary = {"file": str(file), **_describe(file), "bytes": file.stat().st_size}
    shown = summary if console.verbose else summary | {"provenance": _identity(summary.get("provenance", {}))}
    console.result(summary, _rows(shown))


def _identity(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Stage, seed, hashes: what a provenance holds beside nested parts, hashes shortened."""
    plain = {key: value for key, value in provenance.items() if isinstance(value, str | int | float)}
    return {key: value[:12] if isinstance(value, str) else value for key, value in plain.items()}


def _describe(file: Path) -> dict[str, Any]:
    try:
        with file.open("rb") as stream:
            magic = stream.read(4)
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(file), remedy="name a volume, photon map or EXR") from None
    except IsADirectoryError:
        raise InputError("is a folder", where=str(file), remedy="name a file in it, e.g. volume.npz") from None
    if magic == _EXR_MAGIC:
        return _picture(file)
    if magic == _ZIP_MAGIC:
        from skinrender.npz import read_npz

        members = read_npz(file, verify=False)
        if "palette_index" in members:
            return _volume(file)
        if "round_band_start" in members:
            return _photon_map(file)
    raise InputError(
        "is none of this program's files", where=str(file), remedy="known are volume.npz, photons.npz and EXR pictures"
    )


def _volume(file: Path) -> dict[str, Any]:
    from skinrender.skin.volume import load_volume

    volume = load_volume(file)
    return {
        "kind": "volume",
        "voxels": list(volume.shape),
        "bounds_mm": volume.bounds_mm.tolist(),
        "layers": {
            name: [float(top), float(bottom)]
            for name, top, bottom in zip(volume.layer_name[1:], volume.border_z_mm[:-1], volume.border_z_mm[1:])
        },
        "wavelength_nm": _range(volume.wavelength_nm),
        "palette_entries": len(volume.palette_layer),
        "melanin": _range(volume.palette_melanin),
        **_inks(volume),
        "mu_a_per_mm": _range(volume.mu_a[1:]),
        "mu_s_per_mm": _range(volume.mu_s[1:]),
        "g": _range(volume.g[1:]),
        "refractive_index": _range(volume.refractive_index),
        "sides": volume.sides,
        "relief_mm": None if volume.surface_mm is None else _range(volume.surface_mm),
        "provenance": volume.provenance,
    }


def _inks(volume: Any) -> dict[str, Any]:
    """Volume fractions of the inks, where there is a tattoo."""
    if volume.palette_ink is None:
        return {}
    return {"ink": {name: _range(fraction) for name, fraction in zip(volume.ink_name, volume.palette_ink.T)}}


def _photon_map(file: Path) -> dict[str, Any]:
    from skinrender.photonmap.photon_map import open_map

    photon_map = open_map(file)
    return {
        "kind": "photon map",
        "photons": len(photon_map),
        "emitted": int(photon_map.emitted_per_band.sum()),
        "rounds": photon_map.rounds,
        "wavelength_nm": _range(photon_map.wavelength_nm),
        "power_per_photon_W": _range(photon_map.power_per_band),
        "bounds_mm": photon_map.bounds_mm.tolist(),
        "keep_probability": None if photon_map.keep_probability is None else _range(photon_map.keep_probability),
        "layers": list(photon_map.layer_name),
        "seed": photon_map.provenance.get("seed"),
        "provenance": dict(photon_map.provenance),
    }


def _picture(file: Path) -> dict[str, Any]:
    import numpy as np

    from skinrender.film.exr import channel_names, read_exr
    from skinrender.film.spectral_image import SpectralImage

    image = read_exr(file)
    y = image.y()
    described: dict[str, Any] = {
        "kind": "picture",
        "pixels": list(y.shape[::-1]),
        "channels": _grouped(channel_names(file)),
        "luminance": _range(y),
        "luminance_mean": float(y.mean()),
        "pixels_not_finite": int(np.sum(~np.isfinite(y))),
    }
    if isinstance(image, SpectralImage):
        described |= {
            "kind": "spectral picture",
            "wavelength_nm": _range(image.wavelength_nm),
            "radiance_W_per_mm2_sr": _range(image.radiance),
            "mean_by_part": {
                part: float(getattr(image, f"{part}_Y").mean()) for part in ("surface", "single", "multiple")
            },
            "stderr_mean": float(image.stderr_Y.mean()),
            "exposure": image.exposure,
        }
        if "summary" in image.provenance:
            described["summary"] = image.provenance["summary"]
        described["provenance"] = image.provenance
    return described


def _grouped(channels: list[str]) -> list[str]:
    """Channel names, those of the bands of one quantity together: "S0.380,000000nm ... (81)"."""
    groups: dict[str, list[str]] = {}
    for name in channels:
        groups.setdefault(name.partition(".")[0] if name.endswith("nm") else name, []).append(name)
    return [names[0] if len(names) == 1 else f"{names[0]} ... ({len(names)})" for names in groups.values()]


def _range(values: Any) -> dict[str, Any]:
    """Number of values, smallest and largest; those that are not numbers left out."""
    import numpy as np

    values = np.asarray(values)
    known = values[np.isfinite(values)]
    if not known.size:
        return {"count": int(values.size), "min": None, "max": None}
    return {"count": int(values.size), "min": float(known.min()), "max": float(known.max())}


def _rows(summary: Mapping[str, Any]) -> list[Row]:
    return [(key, _text(key, value)) for key, value in summary.items()]


def _text(key: str, value: Any) -> str:
    if isinstance(value, Mapping) and value.keys() == {"count", "min", "max"}:
        return f"{_text(key, value['min'])} to {_text(key, value['max'])}  ({value['count']} values)"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_text(name, item)}" for name, item in value.items())
    if isinstance(value, list):
        return "[" + ", ".join(_text(key, item) for item in value) + "]"
    if key == "bytes":
        return bytes_text(value)
    return f"{value:.6g}" if isinstance(value, float) else "none" if value is None else str(value)
