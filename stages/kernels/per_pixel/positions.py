"""Arithmetic on places and positions in an exemplar, compiled for CPUs and for CUDA; see `arguments`."""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from texloom.stages.kernels.core.compiled import compiled

PIXEL = 256
"""units of a position in a pixel"""
LOW = 2**32 - 1
"""the bits of a position that are its column"""

HELPER = {"forceinline": True, "_nrt": False}
"""options of functions within loops that allocate nothing: without ``_nrt`` arrays from tuples are not counted"""

_TOLERANCE = 192  # within which positions agree


@intrinsic
def rounded_product(typing_context: Any, a: Any, b: Any) -> Any:  # noqa: ARG001
    """a * b of floats, rounded by itself; CUDA would fuse a plain product with the sum that follows."""
    kind = types.float32 if a == b == types.float32 else types.float64

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> ir.Value:
        factors = [
            context.cast(builder, value, given, kind) for value, given in zip(values, signature.args, strict=True)
        ]
        if kind == types.float64 or not builder.module.triple.startswith("nvptx"):
            return builder.fmul(*factors)
        single = ir.FloatType()
        multiply = builder.module.declare_intrinsic("llvm.nvvm.mul.rn.f", (), ir.FunctionType(single, [single] * 2))
        return builder.call(multiply, factors)

    return kind(a, b), generate


@compiled(inline="always")
def place_of(position, pitch):
    """The place nearest to a position."""
    row, column = ((position >> 32) + PIXEL // 2) // PIXEL, ((position & LOW) + PIXEL // 2) // PIXEL
    return row * pitch + column


@compiled(inline="always")
def displace(position, down, across, pitch, rows):
    """A position ``down`` and ``across`` px (floats) from another, kept inside the margin."""
    row = (position >> 32) + np.int64(round(down * np.float32(PIXEL)))
    column = (position & LOW) + np.int64(round(across * np.float32(PIXEL)))
    row, column = max(row, 0), max(column, 0)
    return (min(row, (rows - 1) * PIXEL) << 32) | min(column, (pitch - 1) * PIXEL)


@compiled(_nrt=False)
def advect(position, u, v, jacobian, pitch, rows):
    """A position displaced by an offset in texture, (u, v): midpoint advection along the Jacobians.

    Offsets are float32, or float64 that float32 could hold: products with the Jacobian are then exact.
    """
    half = np.float32(0.5)
    j = jacobian[place_of(position, pitch)]
    down = rounded_product(j[0], u) + rounded_product(j[1], v)
    across = rounded_product(j[2], u) + rounded_product(j[3], v)
    j = jacobian[place_of(displace(position, half * down, half * across, pitch, rows), pitch)]
    down = rounded_product(j[0], u) + rounded_product(j[1], v)
    across = rounded_product(j[2], u) + rounded_product(j[3], v)
    return displace(position, down, across, pitch, rows)


@compiled(inline="always")
def transfer(position, place, pitch):
    """The position in the pixel of another place with the same fractions of a pixel."""
    row = np.int64(np.uint32(place) // np.uint32(pitch))
    part = ((position >> 32) + PIXEL // 2) % PIXEL, ((position & LOW) + PIXEL // 2) % PIXEL
    return (row * PIXEL + part[0] - PIXEL // 2 << 32) + (place - row * pitch) * PIXEL + part[1] - PIXEL // 2


@compiled(inline="always")
def snap_to_valid(position, valid, pitch):
    """The position itself if its place is ``valid``, the nearest valid neighbourhood, else the position of that."""
    if valid == place_of(position, pitch):
        return position
    return ((valid // pitch * PIXEL) << 32) | (valid % pitch * PIXEL)


@compiled(inline="always")
def agree(one, other):
    """Whether two positions are nearly the same."""
    return abs((one >> 32) - (other >> 32)) <= _TOLERANCE and abs((one & LOW) - (other & LOW)) <= _TOLERANCE


@compiled(inline="always")
def pixel_number(row, column):
    """A number for a pixel of the endless result, negative coordinates too."""
    return (np.uint64(row) << np.uint64(32)) ^ (np.uint64(column) & np.uint64(0xFFFFFFFF))


@compiled(inline="always")
def phase_offset(wanted_down, wanted_across, phase_down, phase_across, generators):
    """The offset in texture, 1/256 px, to the nearest place of the wanted phase; see `arguments.PhaseMaps`."""
    p = ((np.int64(wanted_down) - np.int64(phase_down) + 2**31) & LOW) - 2**31
    q = ((np.int64(wanted_across) - np.int64(phase_across) + 2**31) & LOW) - 2**31
    return (p * generators[0] + q * generators[2]) >> 32, (p * generators[1] + q * generators[3]) >> 32
