"""Squared distance between short runs of 16-bit values, as vector instructions.

LLVM leaves a fixed loop over some 40 values scalar (it unrolls the loop before it looks for vectors), which costs a
factor of five in the innermost loop of every patch search. So the loop is written as vector operations. Where the
compiler knows the length of a run, they are of exactly that length; LLVM cuts them to the width of the processor at
hand. Where it does not, so that one kernel does for all lengths, a jump leads to as many as a run has.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_LANES = 32  # 16-bit values in a wide vector register
_HALF = 16  # lanes of the vectors of a run whose length is not known
_VECTORS = 23  # most of these
LENGTHS = range(_HALF, _HALF * _VECTORS + 1)
"""those that a run may have without the compiler knowing"""

_INT16, _INT32, _INT64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)


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
    that stand in a module, which unlike those made in a function are kept compiled. Or it is an int64, one of
    `LENGTHS`. Differences must fit 16 bits, ``length`` / 16 pairs of squares 32 bits.
    """
    return _distance_of(2, first, second, length)


def _distance_of(rows: int, first: Any, second: Any, length: Any) -> Any:
    """What an intrinsic returns that adds the squared differences of so many rows."""
    if isinstance(length, types.IntegerLiteral):
        size = length.literal_value
    elif isinstance(length, types.containers.UniTuple):
        size = length.count
    elif length == types.int64:
        size = None
    else:
        return None
    signature = types.int64(first, types.uint64, second, types.uint64, length)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        def starts(array_type: Any, array: ir.Value, start: ir.Value) -> list[ir.Value]:
            view = context.make_array(array_type)(context, builder, array)
            stride = cgutils.unpack_tuple(builder, view.strides)[0]
            found = [builder.add(builder.ptrtoint(view.data, _INT64), builder.shl(start, _INT64(1)))]
            while len(found) < rows:
                found.append(builder.add(found[-1], stride))
            return found

        first_rows = starts(signature.args[0], values[0], values[1])
        second_rows = starts(signature.args[2], values[2], values[3])
        pairs = [*zip(first_rows, second_rows, strict=True)]
        sums = _sums_of_unknown(builder, pairs, values[4]) if size is None else [_sums(builder, pairs, size)]
        # Only these few sums are widened: their own sum could overflow.
        long = ir.VectorType(_INT64, sums[0].type.count)
        total = ir.Constant(long, None)
        for part in sums:
            total = builder.add(total, builder.zext(part, long))
        reduce = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_INT64, [long]), f"llvm.vector.reduce.add.v{long.count}i64"
        )
        return builder.call(reduce, [total])

    return signature, generate


def _sums(builder: ir.IRBuilder, pairs: Any, size: int) -> ir.Value:
    """Sums of the squared differences of pairs of rows of ``size`` values, a vector of 32 bits."""
    total = ir.Constant(ir.VectorType(_INT32, _LANES // 2), None)
    for pair in pairs:
        for begin in range(0, size, _LANES):
            count = min(_LANES, size - begin)
            difference = _difference(builder, pair, _INT64(begin), count)
            if count < _LANES:
                zeros = ir.Constant(difference.type, None)
                padded = _lanes(min(lane, count) for lane in range(_LANES))
                difference = builder.shuffle_vector(difference, zeros, padded)
            total = _with_squares(builder, total, difference)
    return total


def _sums_of_unknown(builder: ir.IRBuilder, pairs: Any, length: ir.Value) -> list[ir.Value]:
    """The same for each pair of rows of ``length`` values, one of `LENGTHS`."""
    # The last vector ends where the rows do; of its lanes, those that no vector before it has count.
    whole = builder.lshr(builder.sub(length, _INT64(1)), _INT64(_HALF.bit_length() - 1))
    table = ir.Constant(ir.ArrayType(_INT16, 2 * _HALF), [0] * _HALF + [-1] * _HALF)
    at = builder.sub(length, builder.mul(whole, _INT64(_HALF)))
    counted = builder.gep(cgutils.global_constant(builder, "counted_lanes", table), [_INT64(0), at])
    mask = builder.load(builder.bitcast(counted, ir.VectorType(_INT16, _HALF).as_pointer()))
    mask.align = 2
    last = builder.sub(length, _INT64(_HALF))
    totals = [ir.Constant(ir.VectorType(_INT32, _HALF // 2), None)] * len(pairs)
    for row, pair in enumerate(pairs):
        difference = builder.and_(_difference(builder, pair, last, _HALF), mask)
        totals[row] = _with_squares(builder, totals[row], difference)
    # Each block adds a vector of each row and falls into the one for one vector less.
    blocks = [builder.append_basic_block(f"vectors_{count}") for count in range(_VECTORS)]
    sources: list[Any] = [(builder.block, totals)]
    switch = builder.switch(whole, blocks[-1])
    for count in range(_VECTORS - 1):
        switch.add_case(_INT64(count), blocks[count])
    for count in range(_VECTORS - 1, -1, -1):
        builder.position_at_end(blocks[count])
        merged = []
        for row in range(len(pairs)):
            phi = builder.phi(totals[row].type)
            for block, sums in sources:
                phi.add_incoming(sums[row], block)
            merged.append(phi)
        if count:
            begin = _INT64(_HALF * (count - 1))
            added = [
                _with_squares(builder, total, _difference(builder, pair, begin, _HALF))
                for total, pair in zip(merged, pairs, strict=True)
            ]
            sources = [sources[0], (blocks[count], added)]
            builder.branch(blocks[count - 1])
    return merged


def _difference(builder: ir.IRBuilder, rows: Any, begin: ir.Value, count: int) -> ir.Value:
    """Of so many values of two rows, from the address of each."""
    pieces = []
    for row in rows:
        place = builder.add(row, builder.shl(begin, _INT64(1)))
        load = builder.load(builder.inttoptr(place, ir.VectorType(_INT16, count).as_pointer()))
        load.align = 2
        pieces.append(load)
    return builder.sub(*pieces)


def _with_squares(builder: ir.IRBuilder, total: ir.Value, difference: ir.Value) -> ir.Value:
    """A vector of sums, with the squares of a difference added in pairs."""
    count = difference.type.count
    # Squares of 16 bits, and the sums of those side by side, are one instruction.
    difference = builder.sext(difference, ir.VectorType(_INT32, count))
    squares = builder.mul(difference, difference)
    for half in range(2):
        total = builder.add(total, builder.shuffle_vector(squares, squares, _lanes(range(half, count, 2))))
    return total


def _lanes(numbers: Any) -> ir.Constant:
    numbers = list(numbers)
    return ir.Constant(ir.VectorType(_INT32, len(numbers)), numbers)
