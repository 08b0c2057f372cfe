"""Device functions for the decoders' layers on the GPU; all in full float32.

Twin: `kernels/field/decoder.py`.

A first layer is [rows, 32]: hash features (level by level), planes, one-blob. Each encoding is multiplied
with its own rows, so that no kernel has to join the features.
"""

import triton
import triton.language as tl

from hsslam_node.gpu_kernels.field.layout import INVERSE_EXTENT, ORIGIN
from hsslam_node.gpu_kernels.field.one_blob import one_blob, one_blob_slope


@triton.jit
def relative_position(points, floats, k, on):
    """x, y, z [B] of points[k] from the origin (m), 0 outside the bound, and whether they are inside."""
    x = tl.load(points + 3 * k, mask=on, other=0.0)
    y = tl.load(points + 3 * k + 1, mask=on, other=0.0)
    z = tl.load(points + 3 * k + 2, mask=on, other=0.0)
    return _in_box(floats, x, y, z, on)


@triton.jit
def load_position(position, k, live):
    """x, y, z [B] of position[k] where `live`, else 0."""
    x = tl.load(position + 3 * k, mask=live, other=0.0)
    y = tl.load(position + 3 * k + 1, mask=live, other=0.0)
    z = tl.load(position + 3 * k + 2, mask=live, other=0.0)
    return x, y, z


@triton.jit
def world_position(points, pose, floats, k, on):
    """World x, y, z [B] (m) of camera points[k] under pose [3, 4], and what `relative_position` returns."""
    x = tl.load(points + 3 * k, mask=on, other=0.0)
    y = tl.load(points + 3 * k + 1, mask=on, other=0.0)
    z = tl.load(points + 3 * k + 2, mask=on, other=0.0)
    wx = _row(pose, x, y, z)
    wy = _row(pose + 4, x, y, z)
    wz = _row(pose + 8, x, y, z)
    px, py, pz, inside = _in_box(floats, wx, wy, wz, on)
    return wx, wy, wz, px, py, pz, inside


@triton.jit
def weight_rows(layer, first, rows: tl.constexpr):
    """Rows [rows, 32] of a layer, starting at `first`."""
    return tl.load(layer + _rows(first, rows))


@triton.jit
def hash_rows(layer, feature: tl.constexpr, L: tl.constexpr, LP: tl.constexpr):
    """The rows [LP, 32] of one of the two hash features; 0 beyond L."""
    offset, on = _hash_rows(feature, L, LP)
    return tl.load(layer + offset, mask=on, other=0.0)


@triton.jit
def feature_rows(layer, first):
    """Rows [16, 32] for the geometry decoder's output: 0 for the SDF, then the 15 from `first` on."""
    on = tl.arange(0, 16)[:, None] > 0
    return tl.load(layer + _rows(first - 1, 16), mask=on, other=0.0)


@triton.jit
def output_columns(layer, columns: tl.constexpr):
    """A second layer [32, columns], padded with zeros to [32, 16]."""
    offset, on = _columns(columns)
    return tl.load(layer + offset, mask=on, other=0.0)


@triton.jit
def add_weight_rows(layer, first, product, rows: tl.constexpr):
    """Add a gradient [rows, 32] to a layer's."""
    tl.atomic_add(layer + _rows(first, rows), product, sem="relaxed")


@triton.jit
def add_hash_rows(layer, product, feature: tl.constexpr, L: tl.constexpr, LP: tl.constexpr):
    """Add a gradient [LP, 32] to the rows of one hash feature."""
    offset, on = _hash_rows(feature, L, LP)
    tl.atomic_add(layer + offset, product, mask=on, sem="relaxed")


@triton.jit
def add_feature_rows(layer, first, product):
    """Add a gradient [16, 32] to the rows of `feature_rows`."""
    on = (tl.arange(0, 16)[:, None] > 0) & (tl.arange(0, 32)[None, :] >= 0)
    tl.atomic_add(layer + _rows(first - 1, 16), product, mask=on, sem="relaxed")


@triton.jit
def add_output_columns(layer, product, columns: tl.constexpr):
    """Add a gradient [32, 16] to a second layer [32, columns]."""
    offset, on = _columns(columns)
    tl.atomic_add(layer + offset, product, mask=on, sem="relaxed")


@triton.jit
def add_one_blob(layer, first, floats, x, y, z, hidden):
    """hidden [B, 32] plus the one-blob encoding of the position times its 48 rows from `first` on."""
    for axis in tl.static_range(3):
        blob = one_blob(_unit(floats, x, y, z, axis))
        rows = weight_rows(layer, first + 16 * axis, 16)
        hidden = tl.dot(blob, rows, hidden, input_precision="ieee")
    return hidden


@triton.jit
def scatter_one_blob(layer, first, floats, x, y, z, d_hidden):
    """Add the gradient of the one-blob rows."""
    for axis in tl.static_range(3):
        blob = one_blob(_unit(floats, x, y, z, axis))
        product = tl.dot(tl.trans(blob), d_hidden, input_precision="ieee")
        add_weight_rows(layer, first + 16 * axis, product, 16)


@triton.jit
def one_blob_position_gradient(layer, first, floats, x, y, z, d_hidden):
    """d(loss)/d(position) as three [B] (1/m) through the one-blob rows."""
    dx = _blob_axis(layer, first, floats, x, y, z, d_hidden, 0)
    dy = _blob_axis(layer, first, floats, x, y, z, d_hidden, 1)
    dz = _blob_axis(layer, first, floats, x, y, z, d_hidden, 2)
    return dx, dy, dz


@triton.jit
def _blob_axis(layer, first, floats, x, y, z, d_hidden, axis: tl.constexpr):
    rows = weight_rows(layer, first + 16 * axis, 16)
    d_blob = tl.dot(d_hidden, tl.trans(rows), input_precision="ieee")
    t = _unclamped_unit(floats, x, y, z, axis)
    slope = tl.where(((t >= 0.0) & (t <= 1.0))[:, None], one_blob_slope(t), 0.0)
    return tl.sum(d_blob * slope, axis=1) * tl.load(floats + INVERSE_EXTENT + axis)


@triton.jit
def _unit(floats, x, y, z, axis: tl.constexpr):
    """Position along an axis, 0..1 over the first bound, 0 or 1 beyond."""
    return tl.minimum(tl.maximum(_unclamped_unit(floats, x, y, z, axis), 0.0), 1.0)


@triton.jit
def _unclamped_unit(floats, x, y, z, axis: tl.constexpr):
    p = x if axis == 0 else (y if axis == 1 else z)
    return p * tl.load(floats + INVERSE_EXTENT + axis)


@triton.jit
def _in_box(floats, x, y, z, on):
    inside = on & (x >= tl.load(floats)) & (x <= tl.load(floats + 3))
    inside = inside & (y >= tl.load(floats + 1)) & (y <= tl.load(floats + 4))
    inside = inside & (z >= tl.load(floats + 2)) & (z <= tl.load(floats + 5))
    x = tl.where(inside, x - tl.load(floats + ORIGIN), 0.0)
    y = tl.where(inside, y - tl.load(floats + ORIGIN + 1), 0.0)
    z = tl.where(inside, z - tl.load(floats + ORIGIN + 2), 0.0)
    return x, y, z, inside


@triton.jit
def _row(T, x, y, z):
    return tl.load(T) * x + tl.load(T + 1) * y + tl.load(T + 2) * z + tl.load(T + 3)


@triton.jit
def _rows(first, rows: tl.constexpr):
    return (first + tl.arange(0, rows))[:, None] * 32 + tl.arange(0, 32)[None, :]


@triton.jit
def _hash_rows(feature: tl.constexpr, L: tl.constexpr, LP: tl.constexpr):
    level = tl.arange(0, LP)[:, None]
    column = tl.arange(0, 32)[None, :]
    return (2 * level + feature) * 32 + column, (level < L) & (column >= 0)


@triton.jit
def _columns(columns: tl.constexpr):
    row = tl.arange(0, 32)[:, None]
    column = tl.arange(0, 16)[None, :]
    return row * columns + column, (row >= 0) & (column < columns)
