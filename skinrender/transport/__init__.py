"""Numba kernels alone: random numbers, phase function, Fresnel, surfaces and the photon walk.

Units throughout: mm, 1/mm, sr; directions are directions of flight. Nothing here knows a scene, a file or a
process; the kernels read flat arrays that other packages prepare.
"""

from __future__ import annotations

import numba

from skinrender.transport.inner import inner
from skinrender.transport.kernel_cache import cached, name_cache_folder

name_cache_folder()

_ALL = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
# Without numba's reference counts (_nrt): counting each array that a tuple or a view hands out, by atomic instructions,
# took a fifth of the walk in flat skin and half of it under a relief. Such a kernel makes no arrays.
_INNER = {**_ALL, "_nrt": False, "no_cpython_wrapper": True}
kernel = inner(**_INNER)
# For what the walk calls for single photons: a call copies the header of every array in its tuples. Without, the walk
# under a relief takes 1.07 to 1.16 times as long.
inlined_kernel = inner(**_INNER, forceinline=True)
# For the block passes and what they call: reassociation and approximate reciprocals let LLVM vectorize them, which a
# call within would stop. NaN and infinity keep their meaning.
block_kernel = inner(**_INNER, forceinline=True, fastmath={"contract", "arcp", "nsz", "afn", "reassoc"})
# What Python calls; only these are kept on disk.
entry_kernel = cached(numba.njit(**_ALL, cache=True, _nrt=False))
allocating_kernel = cached(numba.njit(**_ALL, cache=True))
