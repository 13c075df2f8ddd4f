"""Kernels that only kernels call: compiled without the wrappers by which Python and C would call them.

An inlined kernel stands in each wrapper whole. Leaving them out saves a fifth to a
quarter of the time that compiling takes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numba
from numba.core.registry import CPUDispatcher


class _InnerKernel(CPUDispatcher):
    """A compiled function without an entrance for Python: a call from there, a test's say, goes through another kernel."""

    def __call__(self, *args):
        return self._through(*args)

    @cached_property
    def _through(self) -> Callable:
        return numba.njit(lambda *args: self(*args))


def inner(jit: Callable) -> Callable:
    """A decorator like `jit`, one of numba's with ``no_cpython_wrapper=True``, whose kernels Python can call all the same."""

    def decorate(function: Callable) -> Callable:
        compiled = jit(function)
        if compiled is not function:  # with the JIT off it is
            compiled.__class__ = _InnerKernel
        return compiled

    return decorate
