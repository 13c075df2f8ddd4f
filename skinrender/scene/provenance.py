"""What each stage reads of a scene, and a hash over just that."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from skinrender.errors import InputError
from skinrender.scene.places import about
from skinrender.scene.schema import Scene
from skinrender.scene.schema_lesion import INKS
from skinrender.scene.schema_light import ILLUMINANTS

BUILD_PARTS = (
    "patch",
    "bands_nm",
    "skin",
    "slab",
    "relief",
    "outside",
    "below",
    "inner_borders",
    "sides",
    "lesions",
)
TRACE_PARTS = (*BUILD_PARTS, "light", "photons.seed", "photons.roulette")
ESTIMATE_PARTS = (*TRACE_PARTS, "camera", "finish", "estimate")


def scene_hash(scene: Scene, parts: Iterable[str]) -> str:
    """SHA-256 (hex) over the values of some parts of a scene and the bytes of the files they name.

    Parameters
    ----------
    parts : names of sections or dotted paths, such as `BUILD_PARTS`; their order does not matter.

    Raises
    ------
    InputError
        When a file that the scene names can not be read.
    """
    parts = sorted(set(parts))
    values = scene.model_dump(mode="json")
    chosen = {part: _value(values, part) for part in parts}
    digest = hashlib.sha256(json.dumps(chosen, sort_keys=True).encode())
    for key, file in _files(scene, parts):
        with about(scene, *key):
            digest.update(hashlib.sha256(_bytes(scene.path(file))).digest())
    return digest.hexdigest()


def _value(values: dict, part: str) -> object:
    for step in part.split("."):
        values = values[step]
    return values


def _files(scene: Scene, parts: list[str]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Keys and names of the files."""
    if "lesions" in parts:
        yield from ((("lesions", i, "pattern"), lesion.pattern) for i, lesion in enumerate(scene.lesions))
        inks = ((i, lesion.ink) for i, lesion in enumerate(scene.lesions) if lesion.kind == "tattoo")
        yield from ((("lesions", i, "ink"), ink) for i, ink in inks if ink not in INKS)
    if "light" in parts and scene.light.spectrum not in ILLUMINANTS:
        yield ("light", "spectrum"), scene.light.spectrum
    if "relief" in parts and scene.relief.kind == "height_map":
        yield ("relief", "file"), scene.relief.file


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(file)) from None
