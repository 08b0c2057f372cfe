"""Vectors of 16 numbers inside njit kernels, for code that the loop vectoriser does not vectorise.

`load`, `store` and `spread` are for vectors of float32 and of keys, uint32 or uint64 (`simd_keys.py`); all
other functions here are for float32.

A vector is one AVX-512 register (two of AVX, four of NEON). Offsets count elements from the first one of a
C-contiguous array; nothing is checked. Arrays of `aligned_zeros` and `aligned_rows` start at a cache line,
so that no vector lies across two lines.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.extending import intrinsic, register_model

from hsslam_node.kernels.compiled import njit

operation: Any = intrinsic  # called without the first parameter, which type checkers do not know
WIDTH = 16
FLOAT, WORD = ir.FloatType(), ir.IntType(32)
VECTOR = ir.VectorType(FLOAT, WIDTH)


class LanesType(types.Type):
    """The numba type of 16 numbers of a kind, which LLVM calls `element`."""

    def __init__(self, name: str, number: types.Number, element: ir.Type) -> None:
        super().__init__(name=name)
        self.number = number
        self.vector = ir.VectorType(element, WIDTH)


LANES = LanesType("Lanes", types.float32, FLOAT)
KEYS = LanesType("Keys", types.uint32, WORD)
LONG_KEYS = LanesType("LongKeys", types.uint64, ir.IntType(64))


def _lanes_of(number: types.Type) -> LanesType:
    keys = {types.uint32: KEYS, types.uint64: LONG_KEYS}
    return keys.get(types.unliteral(number), LANES)


@register_model(LanesType)
class _LanesModel(PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:
        super().__init__(dmm, fe_type, fe_type.vector)


@operation
def load(typingctx, array, offset):
    """The 16 numbers from `offset` on."""
    lanes = _lanes_of(array.dtype)

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], lanes.vector)
        return builder.load(place, align=4)

    return lanes(array, types.intp), codegen


@operation
def store(typingctx, array, offset, lanes):
    """Write 16 numbers from `offset` on."""
    wanted = _lanes_of(array.dtype)

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], wanted.vector)
        builder.store(args[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, wanted), codegen


@operation
def spread(typingctx, value):
    """One number in all lanes."""
    lanes = _lanes_of(value)

    def codegen(context, builder, signature, args):
        return broadcast(builder, args[0], lanes.vector)

    return lanes(lanes.number), codegen


@operation
def fma(typingctx, a, b, c):
    """a * b + c."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        name = "llvm.fma.v16f32"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return LANES(LANES, LANES, LANES), codegen


@operation
def add(typingctx, a, b):
    """a + b."""

    def codegen(context, builder, signature, args):
        return builder.fadd(*args)

    return LANES(LANES, LANES), codegen


@operation
def mul(typingctx, a, b):
    """a * b."""

    def codegen(context, builder, signature, args):
        return builder.fmul(*args)

    return LANES(LANES, LANES), codegen


@operation
def sub(typingctx, a, b):
    """a - b."""

    def codegen(context, builder, signature, args):
        return builder.fsub(*args)

    return LANES(LANES, LANES), codegen


@operation
def div(typingctx, a, b):
    """a / b."""

    def codegen(context, builder, signature, args):
        return builder.fdiv(*args)

    return LANES(LANES, LANES), codegen


@operation
def root(typingctx, a):
    """Square root of a."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(VECTOR, [VECTOR])
        name = "llvm.sqrt.v16f32"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return LANES(LANES), codegen


@operation
def where_positive(typingctx, condition, a):
    """a in the lanes where the condition is above 0, else 0."""

    def codegen(context, builder, signature, args):
        zero = ir.Constant(VECTOR, None)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), args[1], zero)

    return LANES(LANES, LANES), codegen


@operation
def total(typingctx, a):
    """Sum of all lanes."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(FLOAT, [FLOAT, VECTOR])
        name = "llvm.vector.reduce.fadd.v16f32"
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        zero = ir.Constant(FLOAT, 0.0)
        return builder.call(function, [zero, args[0]], fastmath=("reassoc",))

    return types.float32(LANES), codegen


@operation
def any_not_zero(typingctx, array, offset):
    """Whether one of the 16 floats from `offset` on is not 0."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], VECTOR)
        lanes = builder.load(place, align=4)
        set_lanes = builder.fcmp_unordered("!=", lanes, ir.Constant(VECTOR, None))
        bits = builder.bitcast(set_lanes, ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(array, types.intp), codegen


@operation
def lowest_bit(typingctx, word):
    """Number of the lowest bit that is set in a uint64; 64 if none is."""

    def codegen(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.uint64), codegen


def place_of(context, builder, array_type, array, offset, element):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), element.as_pointer())


def broadcast(builder, value, vector):
    none = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, none, indices(*[0] * vector.count))


def indices(*lanes: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))


LINE_BYTES = 64


def aligned_zeros(*shape: int) -> np.ndarray:
    """float32 zeros of this shape, C-contiguous, the first at a multiple of 64 bytes."""
    size = math.prod(shape)
    raw = np.zeros(4 * size + LINE_BYTES, np.uint8)
    start = -raw.ctypes.data % LINE_BYTES
    return raw[start : start + 4 * size].view(np.float32).reshape(shape)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def aligned_rows(rows, columns):
    """The same inside a kernel, [rows, columns], uninitialised."""
    raw = np.empty(rows * columns + 16, np.float32)
    start = (-raw.ctypes.data >> 2) & 15
    return raw[start : start + rows * columns].reshape(rows, columns)
