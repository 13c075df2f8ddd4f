"""The photon map: what is stored of each scattering event, and the file it lies in (paper, section 7.1).

A stored photon carries constant power, looked up by its band; its density already carries the scattering coefficient.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.errors import InputError
from skinrender.npz import forget_pages, read_npz

FORMAT_VERSION = 1
MAX_BANDS = 256
_CHUNK = 1 << 16
_DEPTHS_CHUNK = 1 << 24
_ONCE_PER_MAP = {"format_version": "i", "provenance": "U", "bounds_mm": "f"}
_PER_BAND = {"wavelength_nm": "f", "power_per_band": "f", "emitted_per_band": "i"}


@dataclass(frozen=True, eq=False)
class PhotonMap:
    """Photons in the order round, band, block; N photons, B bands, R rounds. The large arrays are memory-mapped.

    Parameters
    ----------
    position : (N, 3) f4, mm; z downward from the mean surface.
    direction : (N, 2) u2, octahedral direction of flight before the scattering.
    band : (N,) u1.
    wavelength_nm : (B,) f8.
    power_per_band : (B,) f8, W of one stored photon of weight 1: power aimed at the patch / histories emitted.
    emitted_per_band : (B,) i8, histories in all rounds.
    round_band_start : (R * B + 1,) i8, first photon of each round and band.
    bounds_mm : (2, 3) f8, lowest and highest corner of the volume.
    tallies : (R, B, T) i8, counts of `transport.tally`.
    layer_name : names of the L tissue layers, top to bottom.
    provenance : what determines the bytes.
    keep_probability : (B, D) f4 or None; a photon's weight is its reciprocal.
    depth_edges_mm : (D + 1,) f8 or None, the depths that go with it.
    format_version : of the file.
    """

    position: np.ndarray
    direction: np.ndarray
    band: np.ndarray
    wavelength_nm: np.ndarray
    power_per_band: np.ndarray
    emitted_per_band: np.ndarray
    round_band_start: np.ndarray
    bounds_mm: np.ndarray
    tallies: np.ndarray
    layer_name: tuple[str, ...]
    provenance: Mapping[str, Any]
    keep_probability: np.ndarray | None = None
    depth_edges_mm: np.ndarray | None = None
    format_version: int = FORMAT_VERSION

    def __post_init__(self) -> None:
        for photons in (self.position, self.direction):
            photons.flags.writeable = False  # in memory as from a file, so that one compiled kernel takes both

    def __len__(self) -> int:
        return len(self.band)

    @property
    def bands(self) -> int:
        return len(self.wavelength_nm)

    @property
    def rounds(self) -> int:
        return (len(self.round_band_start) - 1) // self.bands

    def round_slice(self, index: int) -> slice:
        """Photons of one round."""
        return slice(*self.round_band_start[[index * self.bands, (index + 1) * self.bands]].tolist())

    def band_slice(self, index: int, band: int) -> slice:
        """Photons of one round and band."""
        first = index * self.bands + band
        return slice(*self.round_band_start[first : first + 2].tolist())

    def of_bands(self, bands: np.ndarray) -> PhotonMap:
        """A map of the photons of some bands (n,), in memory; the others are there, without photons."""
        stored = np.diff(self.round_band_start).reshape(self.rounds, self.bands)
        kept = np.zeros_like(stored)
        kept[:, bands] = stored[:, bands]
        slices = [self.band_slice(index, band) for index in range(self.rounds) for band in np.sort(bands)]
        position, direction, band = (
            np.concatenate([values[part] for part in slices]) for values in (self.position, self.direction, self.band)
        )
        start = np.concatenate([[0], np.cumsum(kept)])
        return replace(self, position=position, direction=direction, band=band, round_band_start=start)

    def forget_pages(self) -> None:
        """Let go of the memory that the map has been read into, lest all of it gather there."""
        for array in (self.position, self.direction, self.band):
            forget_pages(array)

    def depths(self, step: int) -> np.ndarray:
        """z of every `step`-th photon, (N / step,) f4 mm, read with little memory."""
        chunk = step * max(1, _DEPTHS_CHUNK // step)
        found = []
        for start in range(0, len(self), chunk):
            found.append(self.position[start : start + chunk : step, 2].copy())
            forget_pages(self.position)
        return np.concatenate(found) if found else np.empty(0, np.float32)


def open_map(
    path: str | Path,
    *,
    expected: Mapping[str, Any] | None = None,
    verify: bool | None = None,
    check_photons: bool = False,
) -> PhotonMap:
    """Memory-map a photon map and check it.

    Parameters
    ----------
    path : the ``photons.npz``.
    expected : provenance that the map must have, by key (other keys are free).
    verify : compare checksums (reads the whole file); by default for small files only.
    check_photons : also look at every photon: finite, within the bounds, in the order of the bands.

    Raises
    ------
    InputError : missing, damaged, of another version, or made from another scene.
    """
    members = read_npz(path, verify=verify)
    try:
        photon_map = _assemble(members)
        _check_shapes(photon_map)
        if check_photons:
            _check_photons(photon_map)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"not a photon map of this version of skinrender ({str(error) or type(error).__name__})",
            where=str(path),
            remedy="make it again with `skinrender trace`",
        ) from error
    if expected is not None:
        check_provenance(path, photon_map.provenance, expected)
    return photon_map


def check_provenance(
    path: str | Path,
    found: Mapping[str, Any],
    expected: Mapping[str, Any],
    *,
    remedy: str = "make it again with `skinrender trace`, or go back to the scene, program and machine it came from",
) -> None:
    """Raise `InputError` naming the keys of `expected` that `found` does not share."""
    unlike = [key for key, value in expected.items() if found.get(key) != value]
    if unlike:
        raise InputError(
            f"made from something else; it differs in: {', '.join(unlike)}", where=str(path), remedy=remedy
        )


def _assemble(members: dict[str, np.ndarray]) -> PhotonMap:
    version = members.get("format_version")
    if version is None or version.shape != () or version.dtype.kind != "i" or version != FORMAT_VERSION:
        raise ValueError(f"format_version is not {FORMAT_VERSION}")
    small = {**_ONCE_PER_MAP, **_PER_BAND}
    for name, kind in small.items():
        if members[name].dtype.kind != kind:
            raise ValueError(f"{name} has type {members[name].dtype}")
    provenance = json.loads(str(members["provenance"]))
    if not isinstance(provenance, dict):
        raise TypeError("provenance is not an object")
    return PhotonMap(
        **{name: members[name] for name in ("position", "direction", "band", "round_band_start", "tallies")},
        **{name: members[name] for name in ("bounds_mm", *_PER_BAND)},
        layer_name=tuple(members["layer_name"].tolist()),
        provenance=provenance,
        keep_probability=members.get("keep_probability"),
        depth_edges_mm=members.get("depth_edges_mm"),
    )


def _check_shapes(photon_map: PhotonMap) -> None:
    count, bands = photon_map.band.size, photon_map.wavelength_nm.size
    if not 0 < bands <= MAX_BANDS:
        raise ValueError(f"{bands} bands")
    starts = photon_map.round_band_start
    _expect(starts, "round_band_start", "i8", (starts.size,))
    if starts.size % bands != 1 % bands or starts[0] != 0 or starts[-1] != count or (np.diff(starts) < 0).any():
        raise ValueError("round_band_start does not count the photons")
    _expect(photon_map.position, "position", "f4", (count, 3))
    _expect(photon_map.direction, "direction", "u2", (count, 2))
    _expect(photon_map.band, "band", "u1", (count,))
    for name in _PER_BAND:
        _expect(getattr(photon_map, name), name, None, (bands,))
    _expect(photon_map.bounds_mm, "bounds_mm", "f8", (2, 3))
    _expect(photon_map.tallies, "tallies", "i8", (photon_map.rounds, bands, photon_map.tallies.shape[-1]))
    keep, edges = photon_map.keep_probability, photon_map.depth_edges_mm
    if (keep is None) != (edges is None):
        raise ValueError("keep_probability and depth_edges_mm do not go without each other")
    if keep is not None:
        _expect(edges, "depth_edges_mm", "f8", (edges.size,))
        _expect(keep, "keep_probability", "f4", (bands, edges.size - 1))
        if not ((keep >= 0) & (keep <= 1)).all():
            raise ValueError("keep_probability is not a probability")
    for name in ("wavelength_nm", "power_per_band", "bounds_mm"):
        if not np.isfinite(getattr(photon_map, name)).all():
            raise ValueError(f"{name} is not finite")


def _expect(array: np.ndarray, name: str, dtype: str | None, shape: tuple[int, ...]) -> None:
    if array.shape != shape or (dtype is not None and array.dtype != np.dtype(dtype)):
        raise ValueError(f"{name} is {array.dtype} {array.shape}, not {dtype or 'a number'} {shape}")


def _check_photons(photon_map: PhotonMap) -> None:
    low, high = photon_map.bounds_mm
    slack = 1e-5 * (high - low).max()
    for start in range(0, len(photon_map), _CHUNK):
        for axis, at in enumerate(photon_map.position[start : start + _CHUNK].T):
            if not (at.min() >= low[axis] - slack and at.max() <= high[axis] + slack):
                raise ValueError("a photon's position is not a number within the volume")
        if start % _DEPTHS_CHUNK == 0:
            forget_pages(photon_map.position)
    per_band = np.diff(photon_map.round_band_start)
    for index, first in enumerate(photon_map.round_band_start[:-1]):
        if (photon_map.band[first : first + per_band[index]] != index % photon_map.bands).any():
            raise ValueError("the photons are not in the order of rounds and bands")
