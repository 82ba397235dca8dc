"""Projection of the pixels in windows of an image on a few vectors.

The library's matrix product would need a copy of each window, as long as the product itself takes.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.core.vector_size import DIMENSIONS

_LANES = (np.int8(0),) * DIMENSIONS


@intrinsic
def _add_products(
    typing_context: Any, values: Any, starts: Any, basis: Any, first: Any, count: Any, sums: Any, lanes: Any
) -> Any:
    """Add to each row of ``sums`` the products of ``count`` of ``values`` and rows of ``basis`` from ``first`` on.

    ``first`` and ``count`` are int64; ``starts``, a tuple of these, tells where the values for each row of ``sums``
    begin. Arrays are C-contiguous float32; their rows have as many values as the type of ``lanes``, a tuple. The
    sums of four runs take half of the registers of a processor of 512 bits, and all of those of one with 256.
    """
    size = lanes.count
    signature = types.void(values, starts, basis, first, count, sums, lanes)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
        int32, int64, vector = ir.IntType(32), ir.IntType(64), ir.VectorType(ir.FloatType(), size)
        undefined, zeros = ir.Constant(vector, ir.Undefined), ir.Constant(ir.VectorType(int32, size), [0] * size)

        # A product and its sum, rounded once: one instruction, or a call for each value where a processor has none.
        function = ir.FunctionType(vector, [vector] * 3)
        fused = cgutils.get_or_insert_function(builder.module, function, f"llvm.fma.v{size}f32")

        def data(argument: int) -> ir.Value:
            return context.make_array(signature.args[argument])(context, builder, arguments[argument]).data

        def row(pointer: ir.Value, number: ir.Value) -> ir.Value:
            address = builder.add(builder.ptrtoint(pointer, int64), builder.mul(number, int64(4 * size)))
            return builder.inttoptr(address, vector.as_pointer())

        def load(pointer: ir.Value) -> ir.Value:
            loaded = builder.load(pointer)
            loaded.align = 4
            return loaded

        run_starts = cgutils.unpack_tuple(builder, arguments[1])
        pixels, vectors, totals = data(0), data(2), data(5)
        held = [cgutils.alloca_once_value(builder, load(row(totals, int64(k)))) for k in range(len(run_starts))]
        with cgutils.for_range(builder, arguments[4]) as loop:
            factors = load(row(vectors, builder.add(arguments[3], loop.index)))
            for start, total in zip(run_starts, held, strict=True):
                value = builder.load(builder.gep(pixels, [builder.add(start, loop.index)]))
                value = builder.shuffle_vector(builder.insert_element(undefined, value, int32(0)), undefined, zeros)
                builder.store(builder.call(fused, [value, factors, builder.load(total)]), total)
        for k, total in enumerate(held):
            stored = builder.store(builder.load(total), row(totals, int64(k)))
            stored.align = 4
        return context.get_dummy_value()

    return signature, generate


@compiled
def project_windows(image, starts, size, run, basis, offset, longest, out, first, last):
    """Set rows ``first`` to ``last`` of ``out`` to windows of an image, projected, rounded towards zero.

    Parameters
    ----------
    image : (h, row) float32
    starts : (n,) int64, flat indices at which windows begin
    size, run : int, rows of a window, and values in each
    basis : (size * run, DIMENSIONS) float32
    offset : (DIMENSIONS,) float32, subtracted
    longest : float32, length that longer projections are shortened to
    out : (n, DIMENSIONS) int16
    """
    stride = image.shape[1]
    sums = np.empty((4, DIMENSIONS), np.float32)
    for group in range(first, last, 4):
        own = starts[group : min(group + 4, last)]
        a, b, c, d = own[0], own[min(1, own.size - 1)], own[min(2, own.size - 1)], own[own.size - 1]
        for k in range(4):
            for lane in range(DIMENSIONS):
                sums[k, lane] = -offset[lane]
        for i in range(size):
            down = i * stride
            _add_products(
                image, (a + down, b + down, c + down, d + down), basis, np.int64(i * run), np.int64(run), sums,
                _LANES,
            )  # fmt: skip
        for k in range(own.size):
            square = np.float32(0)
            for lane in range(DIMENSIONS):
                square += sums[k, lane] * sums[k, lane]
            factor = np.float32(1)
            if square > longest * longest:
                factor = longest / np.sqrt(square)
            for lane in range(DIMENSIONS):
                out[group + k, lane] = np.int16(sums[k, lane] * factor)
