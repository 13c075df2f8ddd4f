"""Numba kernels alone: random numbers, phase function, Fresnel, surfaces and the photon walk.

Units throughout: mm, 1/mm, sr; directions are directions of flight. Nothing here knows a scene, a file or a
process; the kernels read flat arrays that other packages prepare.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numba

_PACKAGE = Path(__file__).resolve().parent.parent
_KERNEL_PACKAGES = ("transport", "estimate", "film")


def _sources_hash() -> str:
    """Name of the kernels' state: numba does not notice an edit in a *called* module, so the cache is named by all."""
    digest = hashlib.sha256()
    for package in _KERNEL_PACKAGES:
        for path in sorted((_PACKAGE / package).glob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """The user's cache folder; a temporary one where there is no home or it can't be written."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    for root in (Path(base), Path(tempfile.gettempdir()) / f"skinrender-{os.getuid() if hasattr(os, 'getuid') else 0}"):
        try:
            folder = root / "skinrender" / _sources_hash()
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="skinrender-kernels-"))


if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_root())

kernel = numba.njit(cache=True, nogil=True, error_model="numpy")
# For the block passes and what they call: reassociation and approximate reciprocals let LLVM vectorize them.
# NaN and infinity keep their meaning. Forced inlining leaves one compiled copy of each: with two, a process that compiled
# and one that read the cache linked different roundings (positions differed by 7e-6 mm).
block_kernel = numba.njit(
    cache=True, nogil=True, error_model="numpy", forceinline=True,
    fastmath={"contract", "arcp", "nsz", "afn", "reassoc"},
)  # fmt: skip
