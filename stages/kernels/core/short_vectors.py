"""Arithmetic on short vectors of 16-bit integers, each kept in one register of the processor.

Loops over eight values are too short for LLVM to turn into vector instructions by itself. Vectors are rows of
C-contiguous int16 arrays, named by their number; nothing is checked.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from texloom.stages.kernels.core.compiled import compiled, inner

WIDTH = 8
"""values of a vector"""

ONE = 2048
"""length of the vectors that `sum_of_projections` projects on"""

_INT16, _INT32, _INT64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)


def _address(
    context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value, row: ir.Value, size: int
) -> Any:
    """Where row number ``row`` of ``size`` values begins, as a pointer to a vector of ``size``."""
    data = builder.ptrtoint(context.make_array(array_type)(context, builder, array).data, _INT64)
    address = builder.add(data, builder.mul(row, _INT64(2 * size)))
    return builder.inttoptr(address, ir.VectorType(_INT16, size).as_pointer())


@compiled
def paired(basis):
    """A basis as `sum_of_projections` reads it, (4 n, 16) int16, from one for each of n vectors, (8 n, 8) int16.

    A product of vectors of pairs adds the two of a pair.
    """
    pairs = np.empty((basis.shape[0] // 2, 2 * WIDTH), np.int16)
    for row in range(basis.shape[0]):
        for k in range(WIDTH):
            pairs[row // 2, 2 * k + row % 2] = basis[row, k]
    return pairs


@intrinsic
def sum_of_projections(
    typing_context: Any, out: Any, out_row: Any, vectors: Any, rows: Any, basis: Any, first: Any
) -> Any:
    """Set 8 values of ``out`` to the sum of rows of ``vectors``, each projected on a basis of its own and rounded.

    ``rows`` is a tuple of int64. The first is projected on what rows ``first`` to ``first`` + 4 of ``basis`` hold,
    see `paired`, the others on what follows. Products, with vectors of length `ONE`, are divided by it and rounded,
    to even if halfway; they must fit 31 bits, and the sum 16. ``out_row`` is in units of 8 values.
    """
    signature = types.void(out, types.int64, vectors, rows, basis, types.int64)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        eight, pairs, wide = ir.VectorType(_INT32, 8), ir.VectorType(_INT16, 16), ir.VectorType(_INT32, 16)
        none, none_wide = ir.Constant(eight, ir.Undefined), ir.Constant(wide, ir.Undefined)
        bits = ONE.bit_length() - 1

        def all_of(number: int) -> ir.Constant:
            return ir.Constant(eight, [number] * 8)

        total = all_of(0)
        for side, row in enumerate(cgutils.unpack_tuple(builder, values[3])):
            vector = _address(context, builder, signature.args[2], values[2], row, WIDTH)
            vector = builder.bitcast(vector, _INT32.as_pointer())
            product = all_of(0)
            for pair in range(WIDTH // 2):
                two = builder.load(builder.gep(vector, [_INT64(pair)]))
                two.align = 2
                two = builder.insert_element(none, two, _INT32(0))
                two = builder.bitcast(builder.shuffle_vector(two, none, all_of(0)), pairs)
                at = builder.add(values[5], _INT64(WIDTH // 2 * side + pair))
                on = builder.load(_address(context, builder, signature.args[4], values[4], at, 2 * WIDTH))
                on.align = 2
                products = builder.mul(builder.sext(two, wide), builder.sext(on, wide))
                for half in range(2):
                    lanes = ir.Constant(eight, list(range(half, 2 * WIDTH, 2)))
                    product = builder.add(product, builder.shuffle_vector(products, none_wide, lanes))
            odd = builder.and_(builder.ashr(product, all_of(bits)), all_of(1))
            product = builder.add(builder.add(product, odd), all_of(ONE // 2 - 1))
            total = builder.add(total, builder.ashr(product, all_of(bits)))
        to = _address(context, builder, signature.args[0], values[0], values[1], WIDTH)
        store = builder.store(builder.trunc(total, ir.VectorType(_INT16, WIDTH)), to)
        store.align = 2
        return context.get_dummy_value()

    return signature, generate


@inner(forceinline=True, _nrt=False)
def sum_of_eight(out, out_row, vectors, rows, basis, first):
    """`sum_of_projections` of eight rows in an array."""
    at = (rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7])
    sum_of_projections(out, np.int64(out_row), vectors, at, basis, np.int64(first))


@intrinsic
def squared_distance(typing_context: Any, one: Any, one_row: Any, other: Any, other_row: Any, run: Any) -> Any:
    """Squared distance of row ``one_row`` (int64) of ``one`` and row ``other_row`` of ``other``, an int64.

    The type of ``run``, a tuple of integers, tells the length of a row, a multiple of 8. Differences must fit 16
    bits, the result 31.
    """
    if not isinstance(run, types.containers.UniTuple):
        return None
    size = run.count
    signature = types.int64(one, types.int64, other, types.int64, run)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        wide = ir.VectorType(_INT32, size)
        loads = []
        for which in (0, 2):
            pointer = _address(context, builder, signature.args[which], values[which], values[which + 1], size)
            vector = builder.load(pointer)
            vector.align = 2
            loads.append(vector)
        difference = builder.sext(builder.sub(*loads), wide)
        reduce = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_INT32, [wide]), f"llvm.vector.reduce.add.v{size}i32"
        )
        return builder.zext(builder.call(reduce, [builder.mul(difference, difference)]), _INT64)

    return signature, generate


@intrinsic
def copy_eight(typing_context: Any, out: Any, out_row: Any, values: Any, row: Any) -> Any:
    """Copy 8 values; ``out_row`` and ``row`` (int64) are in units of 8."""
    signature = types.void(out, types.int64, values, types.int64)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        to, source = (
            _address(context, builder, signature.args[which], values[which], values[which + 1], WIDTH)
            for which in (0, 2)
        )
        loaded = builder.load(source)
        loaded.align = 2
        store = builder.store(loaded, to)
        store.align = 2
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def fetch_early(typing_context: Any, array: Any, row: Any, run: Any) -> Any:
    """Let the processor begin to read row ``row`` (int64) of ``array``, which may be of any type.

    The type of ``run``, a tuple of integers, tells the length of a row. Nothing happens where there is no such row.
    """
    if not isinstance(run, types.containers.UniTuple):
        return None
    signature = types.void(array, types.int64, run)
    size = run.count

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        data = builder.ptrtoint(context.make_array(signature.args[0])(context, builder, values[0]).data, _INT64)
        stride = size * signature.args[0].dtype.bitwidth // 8
        address = builder.add(data, builder.mul(values[1], _INT64(stride)))
        pointer = builder.inttoptr(address, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, _INT32, _INT32, _INT32])
        function = builder.module.declare_intrinsic("llvm.prefetch", (pointer.type,), kind)
        builder.call(function, [pointer, _INT32(0), _INT32(3), _INT32(1)])
        return context.get_dummy_value()

    return signature, generate
