"""Vectors of 16 float32 inside njit kernels, for what the loop vectoriser does not find by itself.

A vector is one AVX-512 register (two of AVX, four of NEON). Arrays are addressed by a flat offset, in
elements, from their first element and must be C-contiguous; nothing is checked.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.extending import intrinsic, register_model

_operation: Any = intrinsic  # called without the first parameter, which type checkers do not know
_WIDTH = 16
_FLOAT = ir.FloatType()
_VECTOR = ir.VectorType(_FLOAT, _WIDTH)
_PAIR = ir.VectorType(_FLOAT, 2)
_PAIRS = ir.VectorType(ir.DoubleType(), _WIDTH // 2)


class LanesType(types.Type):
    """The numba type of 16 float32."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


_LANES = LanesType()


@register_model(LanesType)
class _LanesModel(PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


@_operation
def load(typingctx, array, offset):
    """The 16 floats from `offset` on."""

    def codegen(context, builder, signature, args):
        place = _place(context, builder, signature.args[0], args[0], args[1], _VECTOR)
        return builder.load(place, align=4)

    return _LANES(array, types.intp), codegen


@_operation
def store(typingctx, array, offset, lanes):
    """Write 16 floats from `offset` on."""

    def codegen(context, builder, signature, args):
        place = _place(context, builder, signature.args[0], args[0], args[1], _VECTOR)
        builder.store(args[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, _LANES), codegen


@_operation
def spread(typingctx, value):
    """One float in all lanes."""

    def codegen(context, builder, signature, args):
        return _broadcast(builder, args[0], _VECTOR)

    return _LANES(types.float32), codegen


@_operation
def fma(typingctx, a, b, c):
    """a * b + c."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        name = "llvm.fma.v16f32"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return _LANES(_LANES, _LANES, _LANES), codegen


@_operation
def add(typingctx, a, b):
    """a + b."""

    def codegen(context, builder, signature, args):
        return builder.fadd(*args)

    return _LANES(_LANES, _LANES), codegen


@_operation
def mul(typingctx, a, b):
    """a * b."""

    def codegen(context, builder, signature, args):
        return builder.fmul(*args)

    return _LANES(_LANES, _LANES), codegen


@_operation
def sub(typingctx, a, b):
    """a - b."""

    def codegen(context, builder, signature, args):
        return builder.fsub(*args)

    return _LANES(_LANES, _LANES), codegen


@_operation
def where_positive(typingctx, condition, a):
    """a in the lanes where the condition is above 0, else 0."""

    def codegen(context, builder, signature, args):
        zero = ir.Constant(_VECTOR, None)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), args[1], zero)

    return _LANES(_LANES, _LANES), codegen


@_operation
def total(typingctx, a):
    """Sum of all lanes."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(_FLOAT, [_FLOAT, _VECTOR])
        name = "llvm.vector.reduce.fadd.v16f32"
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        zero = ir.Constant(_FLOAT, 0.0)
        return builder.call(function, [zero, args[0]], fastmath=("reassoc",))

    return types.float32(_LANES), codegen


@_operation
def load_pairs(typingctx, array, offsets, first, step):
    """Pairs of floats at 8 places: lanes 2 c, 2 c + 1 from `offsets[first + c * step]` on, c = 0..7."""

    def codegen(context, builder, signature, args):
        out = ir.Constant(_PAIRS, ir.Undefined)
        for c, place in enumerate(_pair_places(context, builder, signature, args, ir.DoubleType())):
            pair = builder.load(place, align=4)
            out = builder.insert_element(out, pair, ir.Constant(ir.IntType(32), c))
        return builder.bitcast(out, _VECTOR)

    return _LANES(array, offsets, types.intp, types.intp), codegen


@_operation
def add_pairs(typingctx, array, offsets, first, step, lanes):
    """Add lanes 2 c, 2 c + 1 to the floats at 8 places, one place after the other; see `load_pairs`."""

    def codegen(context, builder, signature, args):
        for c, place in enumerate(_pair_places(context, builder, signature, args, _PAIR)):
            pair = builder.shuffle_vector(args[4], args[4], _indices(2 * c, 2 * c + 1))
            builder.store(builder.fadd(builder.load(place, align=4), pair), place, align=4)
        return context.get_dummy_value()

    return types.void(array, offsets, types.intp, types.intp, _LANES), codegen


@_operation
def spread_pair(typingctx, array, offset):
    """The two floats from `offset` on in lanes 0 1, 2 3, ..., 14 15."""

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        place = _place(context, builder, signature.args[0], args[0], args[1], double)
        return builder.bitcast(_broadcast(builder, builder.load(place, align=4), _PAIRS), _VECTOR)

    return _LANES(array, types.intp), codegen


@_operation
def copy_pair(typingctx, target, offset, source, source_offset):
    """Copy two floats."""

    def codegen(context, builder, signature, args):
        place = _place(context, builder, signature.args[2], args[2], args[3], _PAIR)
        pair = builder.load(place, align=4)
        place = _place(context, builder, signature.args[0], args[0], args[1], _PAIR)
        builder.store(pair, place, align=4)
        return context.get_dummy_value()

    return types.void(target, types.intp, source, types.intp), codegen


@_operation
def store_pair_total(typingctx, array, offset, lanes):
    """Write the sum of the even lanes and the sum of the odd lanes from `offset` on."""

    def codegen(context, builder, signature, args):
        part = args[2]
        for width in (8, 4, 2):
            low = builder.shuffle_vector(part, part, _indices(*range(width)))
            high = builder.shuffle_vector(part, part, _indices(*range(width, 2 * width)))
            part = builder.fadd(low, high)
        place = _place(context, builder, signature.args[0], args[0], args[1], _PAIR)
        builder.store(part, place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, _LANES), codegen


def _place(context, builder, array_type, array, offset, element):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), element.as_pointer())


def _pair_places(context, builder, signature, args, element):
    """Pointers to the 8 places, made one by one as they are asked for."""
    word = ir.IntType(64)
    for c in range(_WIDTH // 2):
        at = builder.add(args[2], builder.mul(args[3], ir.Constant(word, c)))
        index = _place(context, builder, signature.args[1], args[1], at, ir.IntType(32))
        offset = builder.sext(builder.load(index), word)
        yield _place(context, builder, signature.args[0], args[0], offset, element)


def _broadcast(builder, value, vector):
    none = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, none, _indices(*[0] * vector.count))


def _indices(*lanes: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
