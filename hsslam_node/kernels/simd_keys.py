"""Operations on vectors of 16 uint32 or uint64, the keys that a distance transform compares.

Their types are `KEYS` and `LONG_KEYS` of `simd.py`. All vectors of an operation have one type.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils

from hsslam_node.kernels.simd import WIDTH, operation, place_of

_BYTES = ir.VectorType(ir.IntType(8), WIDTH)


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
def where_set(typingctx, array, offset, yes, no):
    """`yes` in the lanes whose byte, of 16 from `offset` on, is not 0, else `no`."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], _BYTES)
        is_set = builder.icmp_unsigned(
            "!=", builder.load(place, align=1), ir.Constant(_BYTES, None)
        )
        return builder.select(is_set, args[2], args[3])

    return yes(array, types.intp, yes, yes), codegen


@operation
def largest_key(typingctx, keys):
    """The largest of the 16."""
    key = keys.vector.element

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(key, [keys.vector])
        name = f"llvm.vector.reduce.umax.v16i{key.width}"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return keys.number(keys), codegen
