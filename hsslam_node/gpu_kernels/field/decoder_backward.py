"""Backward pass of the two decoders on the GPU: to their weights and to the features.

Twin: `kernels/field/backward.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import FieldActivations, Gradient
from hsslam_node.gpu_kernels.field.decoder import (
    add_feature_rows,
    add_hash_rows,
    add_output_columns,
    add_weight_rows,
    feature_rows,
    hash_rows,
    load_position,
    output_columns,
    scatter_one_blob,
    weight_rows,
)
from hsslam_node.gpu_kernels.field.layout import GpuLayout

BLOCK, WARPS = 32, 8  # of one program: points, warps (more points would spill registers)


def color_backward(
    params: Tensor,
    layout: GpuLayout,
    n: int,
    acts: FieldActivations,
    d_rgb: Tensor,
    grad: Gradient | None,
) -> None:
    """Write d_color_in and d_color_hidden of the first n points; add the weights' to `grad`, if given."""
    B = block_size(BLOCK, params)
    _color_backward[(triton.cdiv(n, B),)](
        params, layout.ints, layout.floats, n, acts.position, acts.inside, acts.geometry_out,
        acts.color_in, acts.color_hidden, acts.rgb, d_rgb, grad.values if grad else params,
        acts.d_color_in, acts.d_color_hidden, WEIGHTS=grad is not None, C=layout.channels,
        BLOBS=layout.blob_rows, B=B, num_warps=WARPS,
    )  # fmt: skip


def geometry_backward(
    params: Tensor,
    layout: GpuLayout,
    n: int,
    acts: FieldActivations,
    d_sdf: Tensor,
    grad: Gradient | None,
) -> None:
    """The same for the geometry decoder; call it after `color_backward`."""
    B = block_size(BLOCK, params)
    _geometry_backward[(triton.cdiv(n, B),)](
        params, layout.ints, layout.floats, n, acts.position, acts.inside, acts.geometry_in,
        acts.geometry_hidden, acts.sdf, d_sdf, acts.d_color_hidden, grad.values if grad else params,
        acts.d_geometry_in, acts.d_geometry_hidden, WEIGHTS=grad is not None,
        C=layout.channels, L=layout.levels, LP=layout.padded_levels, BLOBS=layout.blob_rows,
        B=B, num_warps=WARPS,
    )  # fmt: skip


@triton.jit(do_not_specialize=["n"])
def _color_backward(
    parameters, ints, floats, n, position, inside, geometry_out, color_in, color_hidden, rgb, d_rgb,
    values, d_color_in, d_color_hidden, WEIGHTS: tl.constexpr, C: tl.constexpr,
    BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    row = k[:, None]
    on = k < n
    live = tl.load(inside + k, mask=on, other=0) != 0
    column = tl.arange(0, 16)[None, :]
    unit = tl.arange(0, 32)[None, :]
    shown = live[:, None] & (column < 3)
    v = tl.load(rgb + 3 * row + column, mask=shown, other=0.0)
    d_logit = tl.load(d_rgb + 3 * row + column, mask=shown, other=0.0) * v * (1.0 - v)

    V2 = tl.load(ints + 3)
    hidden = tl.load(color_hidden + row * 32 + unit, mask=live[:, None], other=0.0)
    if WEIGHTS:
        product = tl.dot(tl.trans(hidden), d_logit, input_precision="ieee")
        add_output_columns(values + V2, product, 3)
    weights = tl.trans(output_columns(parameters + V2, 3))
    d_hidden = tl.dot(d_logit, weights, input_precision="ieee")
    d_hidden = tl.where(hidden > 0.0, d_hidden, 0.0)
    tl.store(d_color_hidden + row * 32 + unit, d_hidden, mask=on[:, None])

    V1 = tl.load(ints + 2)
    if C > 0:
        for s in tl.static_range(2):
            offset = row * (2 * C) + s * C + tl.arange(0, C)[None, :]
            f = tl.load(color_in + offset, mask=live[:, None], other=0.0)
            if WEIGHTS:
                product = tl.dot(tl.trans(f), d_hidden, input_precision="ieee")
                add_weight_rows(values + V1, s * C, product, C)
            weights = tl.trans(weight_rows(parameters + V1, s * C, C))
            d_f = tl.dot(d_hidden, weights, input_precision="ieee")
            tl.store(d_color_in + offset, d_f, mask=on[:, None])
    g = tl.load(geometry_out + row * 16 + column, mask=live[:, None], other=0.0)
    if WEIGHTS:
        product = tl.dot(tl.trans(g), d_hidden, input_precision="ieee")
        add_feature_rows(values + V1, 2 * C + BLOBS, product)
    if WEIGHTS and BLOBS > 0:
        x, y, z = load_position(position, k, live)
        scatter_one_blob(values + V1, 2 * C, floats, x, y, z, d_hidden)


@triton.jit(do_not_specialize=["n"])
def _geometry_backward(
    parameters, ints, floats, n, position, inside, geometry_in, geometry_hidden, sdf, d_sdf,
    d_color_hidden, values, d_geometry_in, d_geometry_hidden,
    WEIGHTS: tl.constexpr, C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr,
    BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    row = k[:, None]
    on = k < n
    live = tl.load(inside + k, mask=on, other=0) != 0
    column = tl.arange(0, 16)[None, :]
    unit = tl.arange(0, 32)[None, :]
    V1 = parameters + tl.load(ints + 2)
    d_color = tl.load(d_color_hidden + row * 32 + unit, mask=on[:, None], other=0.0)
    weights = tl.trans(feature_rows(V1, 2 * C + BLOBS))
    d_out = tl.dot(d_color, weights, input_precision="ieee")
    phi = tl.load(sdf + k, mask=live, other=1.0)
    d_distance = tl.load(d_sdf + k, mask=live, other=0.0) * (1.0 - phi * phi)
    d_out = tl.where(column == 0, d_distance[:, None], d_out)

    W2 = tl.load(ints + 1)
    hidden = tl.load(geometry_hidden + row * 32 + unit, mask=live[:, None], other=0.0)
    if WEIGHTS:
        product = tl.dot(tl.trans(hidden), d_out, input_precision="ieee")
        add_output_columns(values + W2, product, 16)
    d_hidden = tl.dot(d_out, tl.trans(output_columns(parameters + W2, 16)), input_precision="ieee")
    d_hidden = tl.where(hidden > 0.0, d_hidden, 0.0)
    tl.store(d_geometry_hidden + row * 32 + unit, d_hidden, mask=on[:, None])

    W1 = tl.load(ints)
    width: tl.constexpr = 2 * L + 2 * C
    if L > 0:
        level = tl.arange(0, LP)[None, :]
        for feature in tl.static_range(2):
            offset = row * width + 2 * level + feature
            f = tl.load(geometry_in + offset, mask=live[:, None] & (level < L), other=0.0)
            if WEIGHTS:
                product = tl.dot(tl.trans(f), d_hidden, input_precision="ieee")
                add_hash_rows(values + W1, product, feature, L, LP)
            weights = tl.trans(hash_rows(parameters + W1, feature, L, LP))
            d_f = tl.dot(d_hidden, weights, input_precision="ieee")
            tl.store(d_geometry_in + offset, d_f, mask=on[:, None] & (level < L))
    if C > 0:
        for s in tl.static_range(2):
            offset = row * width + 2 * L + s * C + tl.arange(0, C)[None, :]
            f = tl.load(geometry_in + offset, mask=live[:, None], other=0.0)
            if WEIGHTS:
                product = tl.dot(tl.trans(f), d_hidden, input_precision="ieee")
                add_weight_rows(values + W1, 2 * L + s * C, product, C)
            weights = tl.trans(weight_rows(parameters + W1, 2 * L + s * C, C))
            d_f = tl.dot(d_hidden, weights, input_precision="ieee")
            tl.store(d_geometry_in + offset, d_f, mask=on[:, None])
    if WEIGHTS and BLOBS > 0:
        x, y, z = load_position(position, k, live)
        scatter_one_blob(values + W1, width, floats, x, y, z, d_hidden)
