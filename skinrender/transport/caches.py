"""What a kernel tells the caches: stores that pass them by, and values that will be needed soon.

What a walk writes is read by nobody soon, and would push out the tables it reads. What it reads of the largest table
lies at places that are known a pass ahead.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, overload

from skinrender.transport.vectors import address


def stream(array, index, value):
    """array[index] = value for a contiguous array and an unsigned index, by a nontemporal store."""
    array[index] = value


def prefetch(array, index):
    """Asks for array[index] of a contiguous array, for an unsigned index, without waiting for it."""


@overload(stream, inline="always")
def _stream(array, index, value):
    def store(array, index, value):
        _store_nontemporal(array, index, value)

    return store


@overload(prefetch, inline="always")
def _prefetch(array, index):
    def ask(array, index):
        _ask(array, index)

    return ask


@intrinsic
def _store_nontemporal(_typing, array, index, value):
    """LLVM's store with `!nontemporal`: one of the array's own type, as aligned as its values are."""
    def generate(context, builder, signature, arguments):
        array, index, value = arguments
        stored = builder.store(value, address(context, builder, signature.args[0], array, index))
        stored.set_metadata("nontemporal", builder.module.add_metadata([cgutils.int32_t(1)]))
        return context.get_dummy_value()

    return types.void(array, types.uint64, array.dtype), generate


@intrinsic
def _ask(_typing, array, index):
    """LLVM's prefetch: for reading, into all caches, of data."""
    def generate(context, builder, signature, arguments):
        asked = builder.bitcast(address(context, builder, signature.args[0], *arguments), cgutils.voidptr_t)
        hint = [cgutils.int32_t(value) for value in (0, 3, 1)]
        form = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, *(value.type for value in hint)])
        called = cgutils.get_or_insert_function(builder.module, form, "llvm.prefetch.p0i8")
        builder.call(called, [asked, *hint])
        return context.get_dummy_value()

    return types.void(array, types.uint64), generate
