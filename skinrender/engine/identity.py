"""What determines the bytes of a run besides its scene: the program, and the machine code it becomes."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
WALK_SOURCES = ("transport", "photonmap", "skin/regions.py", "engine/rounds.py")


def program_identity() -> dict[str, str]:
    """Fingerprint of the sources that walk photons, and the versions of what compiles them."""
    return {"walk": _sources_hash(WALK_SOURCES), "numba": version("numba"), "numpy": version("numpy")}


def machine_identity() -> dict[str, str]:
    """Architecture and the processor type that kernels are compiled for; unlike ones may round differently."""
    from llvmlite import binding

    features = binding.get_host_cpu_features().flatten()
    return {
        "architecture": platform.machine(),
        "system": platform.system(),
        "processor": binding.get_host_cpu_name(),
        "features": hashlib.sha256(features.encode()).hexdigest()[:16],
    }


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sources_hash(names: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for name in names:
        place = PACKAGE / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
