"""Stores that pass the caches by: what a walk writes is read by nobody soon, and would push out the tables it reads."""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array


def stream(array, index, value):
    """array[index] = value for a contiguous array and an unsigned index, by a nontemporal store."""
    array[index] = value


@overload(stream, inline="always")
def _stream(array, index, value):
    def store(array, index, value):
        _store_nontemporal(array, index, value)

    return store


@intrinsic
def _store_nontemporal(_typing, array, index, value):
    """LLVM's store with `!nontemporal`: one of the array's own type, as aligned as its values are."""
    def generate(context, builder, signature, arguments):
        data = make_array(signature.args[0])(context, builder, arguments[0]).data
        stored = builder.store(arguments[2], builder.gep(data, [arguments[1]]))
        stored.set_metadata("nontemporal", builder.module.add_metadata([cgutils.int32_t(1)]))
        return context.get_dummy_value()

    return types.void(array, types.uint64, array.dtype), generate
