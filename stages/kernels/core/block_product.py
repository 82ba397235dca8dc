"""Product of a few rows and a few columns, whose sums stay in registers of the processor.

LLVM vectorises a loop over columns, but then loads and stores the sums at every step. So the loop is written with
vectors of sums, a row each: LLVM cuts them to the width of the processor at hand. Every sum adds products in the
order of the rows' values, whatever that width is, and neither is fused.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

ROWS = 6
"""of a block; their sums fill 12 of the 16 registers of 32 bytes"""
BYTES = 64
"""of a row of a block"""


@intrinsic
def block_product(
    typing_context: Any, rows: Any, first: Any, last: Any, panels: Any, panel: Any, out: Any, top: Any, left: Any
) -> Any:
    """Fill `ROWS` rows and c columns of ``out`` with the product of rows ``first``, ``first`` + 1 ... and a panel.

    Parameters
    ----------
    rows : (n, k) float32 or float64, as all arrays C-contiguous; nothing is checked
    first, last : int64; rows from ``last`` on are not read, and give the product of row ``last`` - 1
    panels : (p, k, c), c columns in `BYTES` each
    panel : int64, the number of one
    top, left : int64, where the block begins in ``out``, (m, w)
    """
    signature = types.void(rows, types.int64, types.int64, panels, types.int64, out, types.int64, types.int64)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        int64, size = ir.IntType(64), signature.args[0].dtype.bitwidth // 8
        columns = BYTES // size
        vector = ir.VectorType(context.get_value_type(signature.args[0].dtype), columns)
        none, numbers = ir.Constant(vector, ir.Undefined), ir.VectorType(ir.IntType(32), columns)
        given, packed, found = (
            context.make_array(signature.args[which])(context, builder, values[which]) for which in (0, 3, 5)
        )
        _, count = cgutils.unpack_tuple(builder, given.shape)

        def vector_at(start: ir.Value, value: ir.Value) -> ir.Value:
            return builder.bitcast(builder.gep(start, [value]), vector.as_pointer())

        end = builder.sub(values[2], int64(1))
        lines, sums = [], []
        for number in range(ROWS):
            row = builder.add(values[1], int64(number))
            row = builder.select(builder.icmp_signed("<", row, end), row, end)
            lines.append(builder.gep(given.data, [builder.mul(row, count)]))
            sums.append(cgutils.alloca_once_value(builder, ir.Constant(vector, None)))
        begin = builder.mul(values[4], count)
        with cgutils.for_range(builder, count) as loop:
            place = builder.mul(builder.add(begin, loop.index), int64(columns))
            beside = builder.load(vector_at(packed.data, place), align=size)
            for line, total in zip(lines, sums, strict=True):
                factor = builder.load(builder.gep(line, [loop.index]))
                factor = builder.insert_element(none, factor, int64(0))
                factor = builder.shuffle_vector(factor, none, ir.Constant(numbers, None))
                builder.store(builder.fadd(builder.load(total), builder.fmul(factor, beside)), total)
        _, width = cgutils.unpack_tuple(builder, found.shape)
        for number, total in enumerate(sums):
            place = builder.add(builder.mul(builder.add(values[6], int64(number)), width), values[7])
            builder.store(builder.load(total), vector_at(found.data, place), align=size)
        return context.get_dummy_value()

    return signature, generate
