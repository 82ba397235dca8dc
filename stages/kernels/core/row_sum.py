"""Sum of chosen rows of a table, as vector instructions: loops over a few values are too short for LLVM to see."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic


@intrinsic
def sum_of_rows(typing_context: Any, table: Any, rows: Any, count: Any, total: Any, run: Any) -> Any:
    """Set ``total`` to the sum of rows of ``table``, in their order.

    ``table`` is C-contiguous, float32, of rank 2, ``rows`` are the numbers of its rows, int64, of which the first
    ``count`` (int64) are added, ``total`` is a row. The type of ``run``, a tuple of integers, tells the length of a
    row. Nothing is checked.
    """
    if not isinstance(run, types.containers.UniTuple):
        return None
    size = run.count
    signature = types.void(table, rows, types.int64, total, run)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        int64, vector = ir.IntType(64), ir.VectorType(ir.FloatType(), size)

        def data(number: int) -> ir.Value:
            return context.make_array(signature.args[number])(context, builder, values[number]).data

        first = builder.ptrtoint(data(0), int64)
        accumulator = cgutils.alloca_once_value(builder, ir.Constant(vector, None))
        with cgutils.for_range(builder, values[2]) as loop:
            row = builder.load(builder.gep(data(1), [loop.index]))
            address = builder.add(first, builder.mul(row, int64(4 * size)))
            load = builder.load(builder.inttoptr(address, vector.as_pointer()))
            load.align = 4
            builder.store(builder.fadd(builder.load(accumulator), load), accumulator)
        store = builder.store(builder.load(accumulator), builder.bitcast(data(3), vector.as_pointer()))
        store.align = 4
        return context.get_dummy_value()

    return signature, generate
