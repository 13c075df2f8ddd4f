"""What determines the bytes of a run besides its scene: the program, and the machine code it becomes."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

from skinrender.sources import sources_hash

WALK_SOURCES = ("transport", "photonmap", "skin/regions.py", "skin/volume.py", "engine/rounds.py")
ESTIMATE_SOURCES = (
    "engine/estimate.py", "engine/view.py", "estimate", "film", "optics", "photonmap", "skin", "transport"
)  # fmt: skip


def program_identity() -> dict[str, str]:
    """Fingerprint of the sources that walk photons, and the versions of what compiles them."""
    return {"walk": sources_hash(WALK_SOURCES), "numba": version("numba"), "numpy": version("numpy")}


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
