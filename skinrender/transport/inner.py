"""Kernels that only kernels call: compiled into what their callers take in, never into machine code of their own.

Numba gives every function wrappers for Python and C, optimizes it, and makes machine code of it with a copy of
all that it calls; the caller then takes in the whole once more. For a kernel that nothing else calls all but the last
is for nothing. Such a kernel lacks what numba's `print` needs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering


class _InnerKernel(CPUDispatcher):
    """A compiled function without an entrance for Python: a call from there, a test's say, goes through another kernel."""

    def __call__(self, *args):
        return self._through(*args)

    def add_overload(self, cres) -> None:
        """Known to callers among kernels alone."""
        self.overloads[tuple(cres.signature.args)] = cres

    @cached_property
    def _through(self) -> Callable:
        return numba.njit(lambda *args: self(*args))


class _Ingredient(JITCodeLibrary):
    """Code to be linked into a caller's, and optimized there."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _InnerLowering(NativeLowering):
    """Lower into an `_Ingredient`; callers know it by an object of its own instead of by an entry point."""

    _name = "skinrender_inner_lowering"

    def run_pass(self, state) -> bool:
        state.flags.no_compile = True
        state.library = _Ingredient(state.targetctx.codegen(), state.func_id.func_qualname)
        super().run_pass(state)
        known_by = object()
        state.targetctx.insert_user_function(known_by, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=known_by)
        return True


class _InnerCompiler(CompilerBase):
    def define_pipelines(self):
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state, "skinrender_inner")
        lowering = [each for each, _ in passes.passes].index(NativeLowering)
        passes.passes[lowering] = (_InnerLowering, "lower as an ingredient")
        passes.finalize()
        return [passes]


def inner(**options) -> Callable:
    """A decorator like numba's ``njit(**options)``, whose kernels Python can call all the same, by position."""
    jit = numba.njit(pipeline_class=_InnerCompiler, **options)

    def decorate(function: Callable) -> Callable:
        compiled = jit(function)
        if compiled is not function:  # with the JIT off it is
            compiled.__class__ = _InnerKernel
        return compiled

    return decorate
