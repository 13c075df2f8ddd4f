"""What each of this program's files holds, for `skinrender info`."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

from skinrender.errors import InputError
from skinrender.files import refuse_special

_KNOWN = "known are volume.npz, photons.npz, rounds, EXR pictures, tables (.csv), exported .nrrd and .tif"
_BEGINNINGS = {
    b"\x76\x2f\x31\x01": "exr", b"PK\x03\x04": "npz", b"NRRD": "nrrd", b"II*\x00": "tiff", b"MM\x00*": "tiff"
}  # fmt: skip


def describe(file: Path) -> dict[str, Any]:
    """Kind, content, statistics and provenance of a file.

    Raises
    ------
    InputError : missing, damaged, or of none of the known kinds.
    """
    refuse_special(file)
    try:
        with file.open("rb") as stream:
            kind = _BEGINNINGS.get(stream.read(4))
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(file), remedy="name a volume, photon map or EXR") from None
    except IsADirectoryError:
        raise InputError("is a folder", where=str(file), remedy="name a file in it, e.g. volume.npz") from None
    if kind is None and file.suffix == ".csv":
        kind = "csv"
    if kind is None:
        raise InputError("is none of this program's files", where=str(file), remedy=_KNOWN)
    readers: dict[str, Callable[[Path], dict[str, Any]]] = {
        "exr": _picture, "npz": _archive, "nrrd": _nrrd, "tiff": _tiff, "csv": _table
    }  # fmt: skip
    return readers[kind](file)


def _archive(file: Path) -> dict[str, Any]:
    """A volume, a map, or a part of one."""
    from skinrender.npz import read_npz

    members = read_npz(file, verify=False)
    for member, reader in (
        ("palette_index", _volume), ("round_band_start", _photon_map), ("stored_per_band", _round), ("stored_wanted", _head)
    ):  # fmt: skip
        if member in members:
            return reader(file)
    raise InputError("is none of this program's files", where=str(file), remedy=_KNOWN)


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


def _round(file: Path) -> dict[str, Any]:
    from skinrender.npz import read_npz
    from skinrender.photonmap.store import read_round

    key = str(read_npz(file, verify=False)["key"])
    counts = read_round(file, key)
    return {
        "kind": "round of an unfinished photon pass, or of a shard",
        "index": counts.index,
        "photons": counts.stored,
        "emitted": int(counts.emitted.sum()),
        "bands": len(counts.emitted),
        "provenance": {"run": key},
    }


def _head(file: Path) -> dict[str, Any]:
    from skinrender.photonmap.store import read_header

    header = read_header(file)
    return {
        "kind": "what the rounds beside it have in common",
        "photons_wanted": header.stored_wanted,
        "wavelength_nm": _range(header.wavelength_nm),
        "power_aimed_W": _range(header.power_aimed_per_band),
        "layers": list(header.layer_name),
        "provenance": {"run": header.key, **header.provenance},
    }


def _nrrd(file: Path) -> dict[str, Any]:
    from skinrender.export.nrrd import read_nrrd_header

    return {"kind": "NRRD volume for other programs", **read_nrrd_header(file)}


def _tiff(file: Path) -> dict[str, Any]:
    from skinrender.export.tiff import read_tiff

    stack, labels, told = read_tiff(file)
    return {
        "kind": "spectral stack for ImageJ",
        "pixels": [stack.shape[2], stack.shape[1]],
        "pages": [labels[0], "...", labels[-1]] if len(labels) > 2 else labels,
        "unit": told.get("unit"),
        "values": _range(stack),
        "provenance": told.get("provenance", {}),
    }


def _table(file: Path) -> dict[str, Any]:
    """A table's columns: the range of those that hold numbers, of the others how many different texts."""
    try:
        with open(file, newline="", encoding="utf-8") as stream:
            head, *rows = list(csv.reader(stream))
    except (ValueError, csv.Error):
        raise InputError("is not a table of comma-separated values", where=str(file)) from None
    return {"kind": "table", "rows": len(rows), "columns": {name: _column(values) for name, *values in zip(head, *rows)}}


def _column(cells: list[str]) -> Any:
    try:
        return _range([float(cell) for cell in cells if cell])
    except ValueError:
        kinds = sorted(set(cells))
        return ", ".join(kinds) if len(", ".join(kinds)) < 40 else f"{len(kinds)} different texts"



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
