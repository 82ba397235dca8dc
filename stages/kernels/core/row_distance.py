"""Squared distance between short runs of 16-bit values, as vector instructions.

LLVM leaves a fixed loop over some 40 values scalar (it unrolls the loop before it looks for vectors), which costs a
factor of five in the innermost loop of every patch search. So the loop is written as vector operations of exactly
the run's length; LLVM cuts them to the width of the processor at hand.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_LANES = 16  # partial sums: as many as 32-bit values in a wide vector register


@intrinsic
def two_row_distance(
    typing_context: Any, first: Any, first_start: Any, second: Any, second_start: Any, length: Any
) -> Any:
    """Sum of squared differences of two rows of ``first`` and two rows of ``second``.

    ``first`` and ``second`` are C-contiguous int16 arrays of rank 2. The runs begin at the flat indices
    ``first_start`` and ``second_start`` (uint64) and go on at the same columns of the next row; nothing is checked.
    ``length`` is a compile-time constant, or a tuple of so many integers: its type tells its length also to kernels
    that stand in a module, which unlike those made in a function are kept compiled. Differences must fit 16 bits,
    ``length`` / 16 pairs of squares 32 bits.
    """
    if isinstance(length, types.IntegerLiteral):
        size = length.literal_value
    elif isinstance(length, types.containers.UniTuple):
        size = length.count
    else:
        return None
    signature = types.int64(first, types.uint64, second, types.uint64, length)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        int16, int32, int64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)
        narrow, wide = ir.VectorType(int16, size), ir.VectorType(int32, size)

        def rows(array_type: Any, array: ir.Value, start: ir.Value) -> list[ir.Value]:
            view = context.make_array(array_type)(context, builder, array)
            stride = cgutils.unpack_tuple(builder, view.strides)[0]
            address = builder.add(builder.ptrtoint(view.data, int64), builder.shl(start, int64(1)))
            loads = []
            for row_address in (address, builder.add(address, stride)):
                load = builder.load(builder.inttoptr(row_address, narrow.as_pointer()))
                load.align = 2
                loads.append(load)
            return loads

        first_rows = rows(signature.args[0], values[0], values[1])
        second_rows = rows(signature.args[2], values[2], values[3])
        squares = []
        for one, other in zip(first_rows, second_rows, strict=True):
            difference = builder.sext(builder.sub(one, other), wide)
            squares.append(builder.mul(difference, difference))
        # A few 32-bit sums, and only those widened: one could overflow, widening every square costs a quarter.
        total = builder.add(*squares)
        lanes, zeros = ir.VectorType(int32, _LANES), ir.Constant(wide, None)
        partial = ir.Constant(lanes, None)
        for first_lane in range(0, size, _LANES):
            chosen = ir.Constant(lanes, [min(first_lane + lane, size) for lane in range(_LANES)])
            partial = builder.add(partial, builder.shuffle_vector(total, zeros, chosen))
        long = ir.VectorType(int64, _LANES)
        reduce = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(int64, [long]), f"llvm.vector.reduce.add.v{_LANES}i64"
        )
        return builder.call(reduce, [builder.zext(partial, long)])

    return signature, generate
