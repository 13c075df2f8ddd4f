"""Files of the photon map: one a round while it is made, then all of them streamed into one.

Memory stays flat: a round is written by whoever walked it, and the whole is copied piece by piece.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.errors import InputError
from skinrender.npz import Streamed, npz_bytes, read_npz, write_npz
from skinrender.photonmap.photon_map import FORMAT_VERSION
from skinrender.transport import tally

_PHOTONS_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class MapHeader:
    """What a map holds once, whatever its number of rounds; B bands, L tissue layers.

    Parameters
    ----------
    wavelength_nm : (B,) f8.
    power_aimed_per_band : (B,) f8, W aimed at the patch.
    bounds_mm : (2, 3) f8.
    layer_name : names of the L tissue layers.
    provenance : what determines the bytes of any round.
    stored_wanted : photons at which the map is complete.
    keep_probability, depth_edges_mm : roulette on storage, or None.
    """

    wavelength_nm: np.ndarray
    power_aimed_per_band: np.ndarray
    bounds_mm: np.ndarray
    layer_name: tuple[str, ...]
    provenance: Mapping[str, Any]
    stored_wanted: int
    keep_probability: np.ndarray | None = None
    depth_edges_mm: np.ndarray | None = None

    @property
    def key(self) -> str:
        """Fingerprint of the provenance; every round file carries it."""
        return hashlib.sha256(_json(self.provenance).encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class RoundCounts:
    """A round without its photons: small enough to travel and to keep.

    Parameters
    ----------
    index : of the round.
    emitted : (B,) i8, histories.
    stored_per_band : (B,) i8, photons stored.
    tallies : (B, T) i8, columns of `transport.tally`.
    """

    index: int
    emitted: np.ndarray
    stored_per_band: np.ndarray
    tallies: np.ndarray

    @property
    def stored(self) -> int:
        return int(self.stored_per_band.sum())


def round_path(folder: Path, index: int) -> Path:
    """File of a round."""
    return folder / f"round-{index:06d}.npz"


def round_files(folder: Path) -> dict[int, Path]:
    """Finished rounds in a folder, by index."""
    return {int(path.stem[6:]): path for path in sorted(folder.glob("round-*.npz")) if path.stem[6:].isdecimal()}


def write_round(folder: Path, key: str, walked: Any) -> RoundCounts:
    """Write a walked round (a `photon_pass.Round`) to its file, whole or not at all; returns its counts."""
    counts = RoundCounts(walked.index, walked.emitted, walked.stored_per_band, walked.tallies)
    write_npz(round_path(folder, walked.index), _round_members(counts, key, walked.position, walked.direction))
    return counts


def round_bytes(header: MapHeader, stored: int) -> int:
    """Size of the file of a round that stores `stored` photons."""
    bands, columns = len(header.wavelength_nm), tally.columns(len(header.layer_name))
    per_band, tallies = np.zeros(bands, np.int64), Streamed(np.int64, (bands, columns), ())
    counts = RoundCounts(0, per_band, per_band, tallies)
    return npz_bytes(_round_members(counts, header.key, *_photons(stored, (), ())))


def read_round(path: Path, key: str, *, verify: bool | None = None) -> RoundCounts:
    """Counts of a finished round.

    Raises `InputError` if the file is damaged or its key is not `key`.
    """
    members = read_npz(path, verify=verify)
    try:
        if str(members["key"]) != key:
            raise ValueError("it belongs to another run")
        if path != round_path(path.parent, int(members["index"])):
            raise ValueError(f"it is round {members['index']} by another name")
        counts = RoundCounts(
            int(members["index"]), *(members[name].copy() for name in ("emitted", "stored_per_band", "tallies"))
        )
        if members["position"].shape != (counts.stored, 3) or members["direction"].shape != (counts.stored, 2):
            raise ValueError("it does not hold the photons it counts")
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"not a round of this run ({error})", where=str(path), remedy="delete it") from error
    return counts


def write_header(path: Path, header: MapHeader) -> None:
    """Write what the rounds of a run have in common."""
    write_npz(path, _header_members(header) | {"stored_wanted": np.int64(header.stored_wanted)})


def read_header(path: Path) -> MapHeader:
    """Read what `write_header` wrote; raises `InputError` if it is missing or damaged."""
    members = read_npz(path, mmap=False)
    try:
        if members["format_version"] != FORMAT_VERSION:
            raise ValueError(f"format_version is not {FORMAT_VERSION}")
        return MapHeader(
            **{name: members[name] for name in ("wavelength_nm", "power_aimed_per_band", "bounds_mm")},
            layer_name=tuple(members["layer_name"].tolist()),
            provenance=json.loads(str(members["provenance"])),
            stored_wanted=int(members["stored_wanted"]),
            keep_probability=members.get("keep_probability"),
            depth_edges_mm=members.get("depth_edges_mm"),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"not the head of a run of this version of skinrender ({error})",
            where=str(path),
            remedy="start the run again without --resume",
        ) from error


def write_map(
    path: Path,
    header: MapHeader,
    rounds: Sequence[RoundCounts],
    paths: Sequence[Path],
    check: Callable[[], None] = lambda: None,
) -> None:
    """Stream round files, in order, into one photon map.

    Parameters
    ----------
    path : the ``photons.npz`` to write.
    header : what the rounds have in common.
    rounds, paths : counts and file of each round, from the first.
    check : called often; what it raises ends the writing, and nothing is left of it.
    """
    stored = np.array([counts.stored_per_band for counts in rounds], np.int64)
    starts = np.concatenate([[0], np.cumsum(stored)])
    total = int(starts[-1])
    emitted = np.sum([counts.emitted for counts in rounds], axis=0, dtype=np.int64)
    power = np.divide(header.power_aimed_per_band, emitted, out=np.zeros(len(emitted)), where=emitted > 0)
    tallies = np.array([counts.tallies for counts in rounds], np.int64)
    photons = _photons(total, *(_pieces(paths, name, check) for name in ("position", "direction")))
    band = Streamed(np.uint8, (total,), _bands(stored))
    write_npz(path, _map_members(header, power, emitted, starts, tallies, *photons, band))


def map_bytes(header: MapHeader, rounds: int, stored: int) -> int:
    """Size of the map that `write_map` makes of so many rounds and photons."""
    bands, columns = len(header.wavelength_nm), tally.columns(len(header.layer_name))
    starts = Streamed(np.int64, (rounds * bands + 1,), ())
    tallies = Streamed(np.int64, (rounds, bands, columns), ())
    photons, band = _photons(stored, (), ()), Streamed(np.uint8, (stored,), ())
    return npz_bytes(_map_members(header, np.zeros(bands), np.zeros(bands, np.int64), starts, tallies, *photons, band))


def _photons(count: int, position: Iterable[np.ndarray], direction: Iterable[np.ndarray]) -> tuple[Streamed, Streamed]:
    """Positions and directions of `count` photons, as they are stored."""
    return Streamed(np.float32, (count, 3), position), Streamed(np.uint16, (count, 2), direction)


def _round_members(counts: RoundCounts, key: str, position: Any, direction: Any) -> dict[str, Any]:
    members = {field.name: getattr(counts, field.name) for field in fields(counts)}
    return members | {"position": position, "direction": direction, "key": np.array(key)}


def _map_members(
    header: MapHeader, power: Any, emitted: Any, starts: Any, tallies: Any, position: Any, direction: Any, band: Any
) -> dict[str, Any]:  # fmt: skip
    members = _header_members(header)
    del members["power_aimed_per_band"]
    return members | {
        "power_per_band": power,
        "emitted_per_band": emitted,
        "round_band_start": starts,
        "tallies": tallies,
        "position": position,
        "direction": direction,
        "band": band,
    }


def _pieces(paths: Sequence[Path], name: str, check: Callable[[], None]) -> Iterator[np.ndarray]:
    for path in paths:
        array = read_npz(path, verify=False)[name]
        for start in range(0, len(array), _PHOTONS_AT_ONCE):
            check()
            yield array[start : start + _PHOTONS_AT_ONCE]


def _bands(stored: np.ndarray) -> Iterator[np.ndarray]:
    for row in stored:
        yield np.repeat(np.arange(row.size, dtype=np.uint8), row)


def _header_members(header: MapHeader) -> dict[str, np.ndarray]:
    members = {
        "format_version": np.int64(FORMAT_VERSION),
        "provenance": np.array(_json(header.provenance)),
        "wavelength_nm": np.asarray(header.wavelength_nm, np.float64),
        "power_aimed_per_band": np.asarray(header.power_aimed_per_band, np.float64),
        "bounds_mm": np.asarray(header.bounds_mm, np.float64),
        "layer_name": np.array(header.layer_name),
    }
    if header.keep_probability is not None:
        members["keep_probability"] = np.asarray(header.keep_probability, np.float32)
        members["depth_edges_mm"] = np.asarray(header.depth_edges_mm, np.float64)
    return members


def _json(provenance: Mapping[str, Any]) -> str:
    return json.dumps(provenance, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
