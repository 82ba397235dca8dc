"""Squared distance between short runs of 16-bit values, as vector instructions.

LLVM leaves a fixed loop over some 40 values scalar (it unrolls the loop before it looks for vectors), which costs a
factor of five in the innermost loop of every patch search. So the loop is written as vector operations of exactly
the run's length; LLVM cuts them to the width of the processor at hand.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_LANES = 32  # 16-bit values in a wide vector register


@intrinsic
def row_distance(
    typing_context: Any, first: Any, first_start: Any, second: Any, second_start: Any, length: Any
) -> Any:
    """`two_row_distance` for one row of each."""
    return _distance_of(1, first, second, length)


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
    return _distance_of(2, first, second, length)


def _distance_of(rows: int, first: Any, second: Any, length: Any) -> Any:
    """What an intrinsic returns that adds the squared differences of so many rows."""
    if isinstance(length, types.IntegerLiteral):
        size = length.literal_value
    elif isinstance(length, types.containers.UniTuple):
        size = length.count
    else:
        return None
    signature = types.int64(first, types.uint64, second, types.uint64, length)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        int16, int32, int64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)

        def starts(array_type: Any, array: ir.Value, start: ir.Value) -> list[ir.Value]:
            view = context.make_array(array_type)(context, builder, array)
            stride = cgutils.unpack_tuple(builder, view.strides)[0]
            found = [builder.add(builder.ptrtoint(view.data, int64), builder.shl(start, int64(1)))]
            while len(found) < rows:
                found.append(builder.add(found[-1], stride))
            return found

        def piece(address: ir.Value, begin: int, count: int) -> ir.Value:
            place = builder.add(address, int64(2 * begin))
            load = builder.load(builder.inttoptr(place, ir.VectorType(int16, count).as_pointer()))
            load.align = 2
            return load

        def lanes(numbers: Any) -> ir.Constant:
            numbers = list(numbers)
            return ir.Constant(ir.VectorType(int32, len(numbers)), numbers)

        wide = ir.VectorType(int32, _LANES)
        total = ir.Constant(ir.VectorType(int32, _LANES // 2), None)
        first_rows = starts(signature.args[0], values[0], values[1])
        second_rows = starts(signature.args[2], values[2], values[3])
        for one, other in zip(first_rows, second_rows, strict=True):
            for begin in range(0, size, _LANES):
                count = min(_LANES, size - begin)
                difference = builder.sub(piece(one, begin, count), piece(other, begin, count))
                if count < _LANES:
                    zeros = ir.Constant(difference.type, None)
                    padded = lanes(min(lane, count) for lane in range(_LANES))
                    difference = builder.shuffle_vector(difference, zeros, padded)
                # Squares of 16 bits, and the sums of those side by side, are one instruction.
                difference = builder.sext(difference, wide)
                squares = builder.mul(difference, difference)
                for half in range(2):
                    every_second = builder.shuffle_vector(squares, squares, lanes(range(half, _LANES, 2)))
                    total = builder.add(total, every_second)
        # Only these few sums are widened: their own sum could overflow.
        long = ir.VectorType(int64, _LANES // 2)
        reduce = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(int64, [long]), f"llvm.vector.reduce.add.v{_LANES // 2}i64"
        )
        return builder.call(reduce, [builder.zext(total, long)])

    return signature, generate
