"""Where compiled kernels are kept between runs; a cache that is damaged or cannot be written costs time, nothing else."""

from __future__ import annotations

import hashlib
import os
import pickle
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numba
from numba.core.caching import FunctionCache

_PACKAGE = Path(__file__).resolve().parent.parent
_KERNEL_PACKAGES = ("transport", "estimate", "film")
_DAMAGED = (
    pickle.PickleError, EOFError, struct.error, ArithmeticError, AttributeError, ImportError, LookupError, MemoryError,
    RuntimeError, TypeError, ValueError,
)  # fmt: skip
"""What unpickling nonsense raises."""


class _KernelCache(FunctionCache):
    """Numba's cache of a function, which compiles again what it cannot read and goes on without what it cannot write."""

    def load_overload(self, sig, target_context):
        try:
            found = super().load_overload(sig, target_context)
        except (*_DAMAGED, OSError):
            return None
        # two processes that save at once may leave one's kernel under the other's types
        return found if found is None or found.signature.args == tuple(sig) else None

    def save_overload(self, sig, data) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:
            return
        except _DAMAGED:
            self._start_over(sig, data)

    def _start_over(self, sig, data) -> None:
        try:
            self.flush()
            super().save_overload(sig, data)
        except OSError:
            return


def cached(jit: Callable) -> Callable:
    """A decorator like `jit`, one of numba's with ``cache=True``, whose cache survives damage."""

    def decorate(function: Callable) -> Callable:
        compiled = jit(function)
        if compiled is not function:  # with the JIT off it is
            compiled._cache = _KernelCache(function)
        return compiled

    return decorate


def is_on_disk(kernel: Callable) -> bool:
    """Whether anything that was compiled of a `cached` kernel is kept; with the JIT off nothing is missed."""
    return not hasattr(kernel, "_cache") or os.path.exists(kernel._cache._cache_file._index_path)


def can_keep() -> bool:
    """Whether the cache folder can be written."""
    return os.access(numba.config.CACHE_DIR, os.W_OK)


def kept_in() -> dict[str, str]:
    """Environment of a process that is to keep its kernels where this one does."""
    return {"NUMBA_CACHE_DIR": numba.config.CACHE_DIR}


def name_cache_folder() -> None:
    """Let numba keep kernels in a folder of this program, unless the environment names one."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        numba.config.CACHE_DIR = str(_cache_root())


def _sources_hash() -> str:
    """Name of the kernels' state: numba does not notice an edit in a *called* module, so the cache is named by all."""
    digest = hashlib.sha256()
    for package in _KERNEL_PACKAGES:
        for path in sorted((_PACKAGE / package).glob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """The user's cache folder; a temporary one where there is no home or it can't be written."""
    base, state = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"), _sources_hash()
    user = os.getuid() if hasattr(os, "getuid") else 0
    for folder in (Path(base, "skinrender", state), Path(tempfile.gettempdir(), f"skinrender-{user}-{state}")):
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            if os.access(folder, os.W_OK) and _is_ours(folder):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="skinrender-kernels-"))


def _is_ours(folder: Path) -> bool:
    """Whether nobody else can put code there: kernels are pickled, and the temporary folder is everybody's."""
    if not hasattr(os, "getuid"):
        return True
    found = folder.stat()
    return found.st_uid == os.getuid() and not found.st_mode & 0o022
