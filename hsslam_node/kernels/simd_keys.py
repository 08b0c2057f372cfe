"""Operations on vectors of 16 uint32 or uint64, the keys that a distance transform compares.

Their types are `KEYS` and `LONG_KEYS` of `simd.py`. All vectors of an operation have one type.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils

from hsslam_node.kernels.simd import WIDTH, broadcast, operation, place_of

_BYTES, _BITS = (ir.VectorType(ir.IntType(width), WIDTH) for width in (8, 1))


@operation
def add_keys(typingctx, a, b):
    """a + b."""

    def codegen(context, builder, signature, args):
        return builder.add(*args)

    return a(a, a), codegen


@operation
def masked_keys(typingctx, a, b):
    """The bits that are set in both."""

    def codegen(context, builder, signature, args):
        return builder.and_(*args)

    return a(a, a), codegen


@operation
def least_keys(typingctx, a, b):
    """The smaller of both, lane by lane."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.icmp_unsigned("<", *args), *args)

    return a(a, a), codegen


@operation
def where_less(typingctx, a, b, yes, no):
    """`yes` in the lanes where a < b, else `no`."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.icmp_unsigned("<", args[0], args[1]), args[2], args[3])

    return a(a, a, a, a), codegen


@operation
def any_less(typingctx, a, b):
    """Whether a < b in any lane."""

    def codegen(context, builder, signature, args):
        less = builder.bitcast(builder.icmp_unsigned("<", *args), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", less, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(a, a), codegen


@operation
def where_bits(typingctx, bits, yes, no):
    """`yes` in the lanes whose bit of a uint16 is set, the lowest bit first, else `no`."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.bitcast(args[0], _BITS), args[1], args[2])

    return yes(types.uint16, yes, yes), codegen


@operation
def equal_bits(typingctx, array, offset, value):
    """Which of the 16 bytes from `offset` on equal `value`, as bits of a uint16, the lowest first."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], _BYTES)
        is_equal = builder.icmp_unsigned(
            "==", builder.load(place, align=1), broadcast(builder, args[2], _BYTES)
        )
        return builder.bitcast(is_equal, ir.IntType(WIDTH))

    return types.uint16(array, types.intp, types.uint8), codegen


@operation
def largest_key(typingctx, keys):
    """The largest of the 16."""
    key = keys.vector.element

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(key, [keys.vector])
        name = f"llvm.vector.reduce.umax.v16i{key.width}"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return keys.number(keys), codegen
