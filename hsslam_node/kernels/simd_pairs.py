"""Pairs of floats in a vector of 16: what the two features of a hash entry need (see simd.py)."""

from llvmlite import ir
from numba import types

from hsslam_node.kernels.simd import (
    FLOAT,
    LANES,
    VECTOR,
    WIDTH,
    broadcast,
    indices,
    operation,
    place_of,
)

_PAIR = ir.VectorType(FLOAT, 2)
_PAIRS = ir.VectorType(ir.DoubleType(), WIDTH // 2)


@operation
def load_pairs(typingctx, array, offsets, first, step):
    """Pairs of floats at 8 places: lanes 2 c, 2 c + 1 from `offsets[first + c * step]` on, c = 0..7."""

    def codegen(context, builder, signature, args):
        out = ir.Constant(_PAIRS, ir.Undefined)
        for c, place in enumerate(_pair_places(context, builder, signature, args, ir.DoubleType())):
            pair = builder.load(place, align=4)
            out = builder.insert_element(out, pair, ir.Constant(ir.IntType(32), c))
        return builder.bitcast(out, VECTOR)

    return LANES(array, offsets, types.intp, types.intp), codegen


@operation
def add_pairs(typingctx, array, offsets, first, step, lanes):
    """Add lanes 2 c, 2 c + 1 to the floats at 8 places, one place after the other; see `load_pairs`."""

    def codegen(context, builder, signature, args):
        for c, place in enumerate(_pair_places(context, builder, signature, args, _PAIR)):
            pair = builder.shuffle_vector(args[4], args[4], indices(2 * c, 2 * c + 1))
            builder.store(builder.fadd(builder.load(place, align=4), pair), place, align=4)
        return context.get_dummy_value()

    return types.void(array, offsets, types.intp, types.intp, LANES), codegen


@operation
def spread_pair(typingctx, array, offset):
    """The two floats from `offset` on in lanes 0 1, 2 3, ..., 14 15."""

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        place = place_of(context, builder, signature.args[0], args[0], args[1], double)
        return builder.bitcast(broadcast(builder, builder.load(place, align=4), _PAIRS), VECTOR)

    return LANES(array, types.intp), codegen


@operation
def transpose_pairs(typingctx, target, offset, stride, source, source_offset, source_stride):
    """Copy 8 x 8 pairs of floats: pair j of target row i is pair i of source row j; strides in floats."""

    def codegen(context, builder, signature, args):
        target, offset, stride, source, source_offset, source_stride = args
        word = ir.IntType(64)
        rows = []
        for j in range(8):
            at = builder.add(source_offset, builder.mul(source_stride, ir.Constant(word, j)))
            place = place_of(context, builder, signature.args[3], source, at, _PAIRS)
            rows.append(builder.load(place, align=4))
        for width in (1, 2, 4):  # swap blocks of this size across the diagonal
            for i in (i for i in range(8) if not i & width):
                low = [k if not k & width else k - width + 8 for k in range(8)]
                high = [k + width if not k & width else k + 8 for k in range(8)]
                a, b = rows[i], rows[i + width]
                rows[i] = builder.shuffle_vector(a, b, indices(*low))
                rows[i + width] = builder.shuffle_vector(a, b, indices(*high))
        for i, row in enumerate(rows):
            at = builder.add(offset, builder.mul(stride, ir.Constant(word, i)))
            place = place_of(context, builder, signature.args[0], target, at, _PAIRS)
            builder.store(row, place, align=4)
        return context.get_dummy_value()

    place = (types.intp, types.intp)
    return types.void(target, *place, source, *place), codegen


@operation
def copy_pair(typingctx, target, offset, source, source_offset):
    """Copy two floats."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[2], args[2], args[3], _PAIR)
        pair = builder.load(place, align=4)
        place = place_of(context, builder, signature.args[0], args[0], args[1], _PAIR)
        builder.store(pair, place, align=4)
        return context.get_dummy_value()

    return types.void(target, types.intp, source, types.intp), codegen


@operation
def store_pair_total(typingctx, array, offset, lanes):
    """Write the sum of the even lanes and the sum of the odd lanes from `offset` on."""

    def codegen(context, builder, signature, args):
        part = args[2]
        for width in (8, 4, 2):
            low = builder.shuffle_vector(part, part, indices(*range(width)))
            high = builder.shuffle_vector(part, part, indices(*range(width, 2 * width)))
            part = builder.fadd(low, high)
        place = place_of(context, builder, signature.args[0], args[0], args[1], _PAIR)
        builder.store(part, place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, LANES), codegen


def _pair_places(context, builder, signature, args, element):
    """Pointers to the 8 places, made one by one."""
    word = ir.IntType(64)
    for c in range(WIDTH // 2):
        at = builder.add(args[2], builder.mul(args[3], ir.Constant(word, c)))
        index = place_of(context, builder, signature.args[1], args[1], at, ir.IntType(32))
        offset = builder.sext(builder.load(index), word)
        yield place_of(context, builder, signature.args[0], args[0], offset, element)
