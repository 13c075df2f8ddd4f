"""Several lanes at once where LLVM would not find the vectors by itself.

Each of these is a Python function, which says what it does and does it with the JIT off, and LLVM's instructions for it.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array

SQUEEZED = 16  # lanes that `append_set` looks at
DEALT = 4  # rows of four words that `deal_rows` takes
_WORD, _INDEX = ir.IntType(32), ir.IntType(64)


def append_set(w, at, first, n, end):
    """Of the lanes `first` and on, SQUEEZED of them, writes to w[end:] those below n whose word, in w[at:], is set.

    Returns their number. The next words, SQUEEZED in all, have no meaning any more. at, end: unsigned.
    """
    lanes = [first + k for k in range(SQUEEZED) if first + k < n and w[int(at) + k] != 0]
    w[int(end) : int(end) + len(lanes)] = lanes
    return np.uint64(len(lanes))


def deal_rows(rows, a, b, c, d, words, first, second, fourth, f, third):
    """Deals four rows of four words, at rows[a:], [b:], [c:] and [d:], to four lanes.

    Their first members go to words[first:], their second to words[second:], their fourth to words[fourth:], and the third,
    bits of a float32, to f[third:]. All indices unsigned.
    """
    for lane, row in enumerate((int(a), int(b), int(c), int(d))):
        words[int(first) + lane], words[int(second) + lane] = rows[row], rows[row + 1]
        f[int(third) + lane], words[int(fourth) + lane] = rows[row + 2].view(np.float32), rows[row + 3]


@overload(append_set, inline="always")
def _append_set(w, at, first, n, end):
    if not _is_flat(w, types.int32):
        return None

    def append(w, at, first, n, end):
        return _squeeze(w, at, first, n, end)

    return append


@overload(deal_rows, inline="always")
def _deal_rows(rows, a, b, c, d, words, first, second, fourth, f, third):
    if not (_is_flat(rows, types.int32) and _is_flat(words, types.int32) and _is_flat(f, types.float32, types.float64)):
        return None

    def deal(rows, a, b, c, d, words, first, second, fourth, f, third):
        _transpose(rows, a, b, c, d, words, first, second, fourth, f, third)

    return deal


def _is_flat(array, *dtypes) -> bool:
    """Whether values lie one after the other, so that some are a vector."""
    return isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C" and array.dtype in dtypes


def address(context, builder, array_type, array, index):
    """LLVM's pointer to array[index] of a contiguous array, for an unsigned index."""
    return builder.gep(make_array(array_type)(context, builder, array).data, [index])


def _vector_at(context, builder, array_type, array, index, vector):
    return builder.bitcast(address(context, builder, array_type, array, index), vector.as_pointer())


@intrinsic
def _squeeze(_typing, w, at, first, n, end):
    """LLVM's vector.compress where it is an instruction; elsewhere that would take twice as long as word by word."""
    def generate(context, builder, signature, arguments):
        w, at, first, n, end = arguments
        words = ir.VectorType(_WORD, SQUEEZED)
        nothing, zeros = ir.Constant(words, ir.Undefined), ir.Constant(words, [0] * SQUEEZED)

        def all_of(value):
            one = builder.insert_element(nothing, builder.trunc(value, _WORD), ir.Constant(_WORD, 0))
            return builder.shuffle_vector(one, nothing, zeros)

        def place(index, kind):
            return _vector_at(context, builder, signature.args[0], w, index, kind)

        lanes = builder.add(all_of(first), ir.Constant(words, list(range(SQUEEZED))))
        flags = builder.load(place(at, words), align=4)
        is_set = builder.and_(builder.icmp_signed("!=", flags, zeros), builder.icmp_signed("<", lanes, all_of(n)))
        if "+avx512f" in context.codegen().magic_tuple()[-1].split(","):
            form = ir.FunctionType(words, [words, is_set.type, words])
            compress = builder.module.declare_intrinsic(f"llvm.experimental.vector.compress.v{SQUEEZED}i32", (), form)
            builder.store(builder.call(compress, [lanes, is_set, nothing]), place(end, words), align=4)
            return builder.zext(builder.ctpop(builder.bitcast(is_set, ir.IntType(SQUEEZED))), _INDEX)
        listed = end
        for k in range(SQUEEZED):
            lane, counts = (builder.extract_element(each, ir.Constant(_WORD, k)) for each in (lanes, is_set))
            builder.store(lane, place(listed, _WORD), align=4)
            listed = builder.add(listed, builder.zext(counts, _INDEX))
        return builder.sub(listed, end)

    return types.uint64(w, types.uint64, types.int64, types.int64, types.uint64), generate


@intrinsic
def _transpose(_typing, rows, a, b, c, d, words, first, second, fourth, f, third):
    """Four loads of a row, a transposition by shuffles, four stores of a member."""
    def generate(context, builder, signature, arguments):
        rows, a, b, c, d, words, first, second, fourth, f, third = arguments
        four = ir.VectorType(_WORD, DEALT)

        def row_at(index):
            return builder.load(_vector_at(context, builder, signature.args[0], rows, index, four), align=4)

        def shuffle(x, y, *members):
            return builder.shuffle_vector(x, y, ir.Constant(four, members))

        def put(array_type, array, index, values):
            builder.store(values, _vector_at(context, builder, array_type, array, index, values.type), align=4)

        (a, b), (c, d) = map(row_at, (a, b)), map(row_at, (c, d))
        low_ab, low_cd, high_ab, high_cd = (shuffle(x, y, k, k + 4, k + 1, k + 5) for k in (0, 2) for x, y in ((a, b), (c, d)))
        floats = builder.bitcast(shuffle(high_ab, high_cd, 0, 1, 4, 5), ir.VectorType(ir.FloatType(), DEALT))
        if signature.args[9].dtype == types.float64:
            floats = builder.fpext(floats, ir.VectorType(ir.DoubleType(), DEALT))
        put(signature.args[5], words, first, shuffle(low_ab, low_cd, 0, 1, 4, 5))
        put(signature.args[5], words, second, shuffle(low_ab, low_cd, 2, 3, 6, 7))
        put(signature.args[9], f, third, floats)
        put(signature.args[5], words, fourth, shuffle(high_ab, high_cd, 2, 3, 6, 7))
        return context.get_dummy_value()

    index = types.uint64
    return types.void(rows, index, index, index, index, words, index, index, index, f, index), generate
