"""Arithmetic on short vectors of 16-bit integers, each kept in one register of the processor.

Loops over eight values are too short for LLVM to turn into vector instructions by itself. Vectors are rows of
C-contiguous int16 arrays, named by their number; nothing is checked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

WIDTH = 8
"""values that `sum_of_rows` adds"""

_INT16, _INT32, _INT64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)


def _address(
    context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value, row: ir.Value, size: int
) -> Any:
    """Where row number ``row`` of ``size`` values begins, as a pointer to a vector of ``size``."""
    data = builder.ptrtoint(context.make_array(array_type)(context, builder, array).data, _INT64)
    address = builder.add(data, builder.mul(row, _INT64(2 * size)))
    return builder.inttoptr(address, ir.VectorType(_INT16, size).as_pointer())


@intrinsic
def sum_of_rows(typing_context: Any, out: Any, table: Any, rows: Any) -> Any:
    """Set the first 8 values of ``out`` to the sum of rows of ``table``, (n, 8) int16; it must fit 16 bits.

    ``rows`` is a tuple of int64.
    """
    signature = types.void(out, table, rows)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        total = None
        for row in cgutils.unpack_tuple(builder, values[2]):
            vector = builder.load(_address(context, builder, signature.args[1], values[1], row, WIDTH))
            vector.align = 2
            total = vector if total is None else builder.add(total, vector)
        store = builder.store(total, _address(context, builder, signature.args[0], values[0], _INT64(0), WIDTH))
        store.align = 2
        return context.get_dummy_value()

    return signature, generate


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
