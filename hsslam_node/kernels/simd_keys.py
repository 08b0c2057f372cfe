"""Vectors of 16 uint32 inside njit kernels: what a distance transform compares (see simd.py)."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.extending import register_model

from hsslam_node.kernels.simd import WIDTH, broadcast, operation, place_of

_WORD = ir.IntType(32)
_VECTOR = ir.VectorType(_WORD, WIDTH)
_BYTES = ir.VectorType(ir.IntType(8), WIDTH)


class KeysType(types.Type):
    """The numba type of 16 uint32."""

    def __init__(self) -> None:
        super().__init__(name="Keys")


KEYS = KeysType()


@register_model(KeysType)
class _KeysModel(PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


@operation
def load_keys(typingctx, array, offset):
    """The 16 uint32 from `offset` on."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], _VECTOR)
        return builder.load(place, align=4)

    return KEYS(array, types.intp), codegen


@operation
def store_keys(typingctx, array, offset, keys):
    """Write 16 uint32 from `offset` on."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], _VECTOR)
        builder.store(args[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, KEYS), codegen


@operation
def spread_key(typingctx, value):
    """One uint32 in all lanes."""

    def codegen(context, builder, signature, args):
        return broadcast(builder, args[0], _VECTOR)

    return KEYS(types.uint32), codegen


@operation
def add_keys(typingctx, a, b):
    """a + b."""

    def codegen(context, builder, signature, args):
        return builder.add(*args)

    return KEYS(KEYS, KEYS), codegen


@operation
def least_keys(typingctx, a, b):
    """The smaller of both, lane by lane."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.icmp_unsigned("<", *args), *args)

    return KEYS(KEYS, KEYS), codegen


@operation
def where_less(typingctx, a, b, yes, no):
    """`yes` in the lanes where a < b, else `no`."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.icmp_unsigned("<", args[0], args[1]), args[2], args[3])

    return KEYS(KEYS, KEYS, KEYS, KEYS), codegen


@operation
def where_set(typingctx, array, offset, yes, no):
    """`yes` in the lanes whose byte, of 16 from `offset` on, is not 0, else `no`."""

    def codegen(context, builder, signature, args):
        place = place_of(context, builder, signature.args[0], args[0], args[1], _BYTES)
        is_set = builder.icmp_unsigned(
            "!=", builder.load(place, align=1), ir.Constant(_BYTES, None)
        )
        return builder.select(is_set, args[2], args[3])

    return KEYS(array, types.intp, KEYS, KEYS), codegen


@operation
def largest_key(typingctx, keys):
    """The largest of the 16."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(_WORD, [_VECTOR])
        name = "llvm.vector.reduce.umax.v16i32"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return types.uint32(KEYS), codegen
