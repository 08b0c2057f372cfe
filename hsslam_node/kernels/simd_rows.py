"""Gathers rows of a table as vectors; the loop vectoriser would gather single numbers (see simd.py)."""

from llvmlite import ir
from numba import types

from hsslam_node.kernels.simd import FLOAT, WIDTH, indices, operation, place_of

_COLUMNS = WIDTH // 2
_ROW = ir.VectorType(FLOAT, _COLUMNS)
_WORD, _INDEX = ir.IntType(32), ir.IntType(64)


@operation
def store_columns(typingctx, target, offset, stride, table, rows):
    """Write the 8 columns of 16 rows of a table [n, 8] float32, 16 floats each, `stride` floats apart.

    `rows`: their numbers, uint32 or uint64 (`KEYS`, `LONG_KEYS`).
    """

    def codegen(context, builder, signature, args):
        target, offset, stride, table, rows = args
        found = []
        for lane in range(WIDTH):
            row = builder.extract_element(rows, ir.Constant(_WORD, lane))
            at = builder.mul(builder.zext(row, _INDEX), ir.Constant(_INDEX, _COLUMNS))
            place = place_of(context, builder, signature.args[3], table, at, _ROW)
            found.append(builder.load(place, align=4))
        both = indices(*range(WIDTH))
        lines = [
            builder.shuffle_vector(found[n], found[n + _COLUMNS], both) for n in range(_COLUMNS)
        ]
        for width in (1, 2, 4):  # swap blocks of this size across the diagonal of each half
            for i in (i for i in range(_COLUMNS) if not i & width):
                low = [k if not k & width else k - width + WIDTH for k in range(WIDTH)]
                high = [k + width if not k & width else k + WIDTH for k in range(WIDTH)]
                a, b = lines[i], lines[i + width]
                lines[i] = builder.shuffle_vector(a, b, indices(*low))
                lines[i + width] = builder.shuffle_vector(a, b, indices(*high))
        for n, line in enumerate(lines):
            at = builder.add(offset, builder.mul(stride, ir.Constant(_INDEX, n)))
            place = place_of(context, builder, signature.args[0], target, at, line.type)
            builder.store(line, place, align=4)
        return context.get_dummy_value()

    return types.void(target, types.intp, types.intp, table, rows), codegen
