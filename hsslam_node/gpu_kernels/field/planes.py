"""Tri-plane look-ups on the GPU: bilinear gather, its scatter, and its derivative by position.

Twin: `kernels/field/planes.py`.

Device functions over a block of B points with positions x, y, z [B] (m, from vertex (0, 0, 0)).
Plane sets and planes are numbered as in `kernel_layout`. The C channels are innermost, so that a warp reads
a vertex with one load.
"""

import triton
import triton.language as tl

from hsslam_node.gpu_kernels.field.layout import CELLS, PLANES


@triton.jit
def gather_planes(params, ints, floats, plane_set, x, y, z, live, C: tl.constexpr):
    """Sum of the three planes' features, [B, C]; points that are not `live` [B] get 0."""
    inv_cell = tl.load(floats + CELLS + plane_set)
    channel = tl.arange(0, C)[None, :]
    total = tl.zeros([x.shape[0], C], tl.float32)
    for plane in tl.static_range(3):
        u = x if plane < 2 else y
        v = y if plane == 0 else z
        o00, o10, fu, fv = plane_corners(ints, 3 * plane_set + plane, inv_cell, u, v, C)
        low = params + o00[:, None] + channel
        high = params + o10[:, None] + channel
        a = tl.load(low, mask=live[:, None], other=0.0)
        b = tl.load(low + C, mask=live[:, None], other=0.0)
        c = tl.load(high, mask=live[:, None], other=0.0)
        d = tl.load(high + C, mask=live[:, None], other=0.0)
        fu = fu[:, None]
        fv = fv[:, None]
        total += (1.0 - fv) * (a + fu * (b - a)) + fv * (c + fu * (d - c))
    return total


@triton.jit
def plane_position_gradient(params, ints, floats, plane_set, x, y, z, live, d, C: tl.constexpr):
    """d(loss)/d(position) as three [B] (1/m) from d [B, C], the gradient by `gather_planes`."""
    inv_cell = tl.load(floats + CELLS + plane_set)
    channel = tl.arange(0, C)[None, :]
    dx = tl.zeros_like(x)
    dy = tl.zeros_like(x)
    dz = tl.zeros_like(x)
    for plane in tl.static_range(3):
        u = x if plane < 2 else y
        v = y if plane == 0 else z
        o00, o10, fu, fv = plane_corners(ints, 3 * plane_set + plane, inv_cell, u, v, C)
        low = params + o00[:, None] + channel
        high = params + o10[:, None] + channel
        a = tl.sum(d * tl.load(low, mask=live[:, None], other=0.0), axis=1)
        b = tl.sum(d * tl.load(low + C, mask=live[:, None], other=0.0), axis=1)
        c = tl.sum(d * tl.load(high, mask=live[:, None], other=0.0), axis=1)
        e = tl.sum(d * tl.load(high + C, mask=live[:, None], other=0.0), axis=1)
        du = inv_cell * ((1.0 - fv) * (b - a) + fv * (e - c))
        dv = inv_cell * ((1.0 - fu) * (c - a) + fu * (e - b))
        if plane < 2:
            dx += du
        else:
            dy += du
        if plane == 0:
            dy += dv
        else:
            dz += dv
    return dx, dy, dz


@triton.jit
def scatter_plane(values, touched, ints, floats, plane, u, v, live, d, C: tl.constexpr):
    """Add d [B, C], the gradient by the features of one plane (0..11), and mark the chunks."""
    inv_cell = tl.load(floats + CELLS + plane // 3)
    o00, o10, fu, fv = plane_corners(ints, plane, inv_cell, u, v, C)
    channel = tl.arange(0, C)[None, :]
    low = o00[:, None] + channel
    high = o10[:, None] + channel
    mask = live[:, None]
    fu = fu[:, None]
    fv = fv[:, None]
    tl.atomic_add(values + low, (1.0 - fu) * (1.0 - fv) * d, mask=mask, sem="relaxed")
    tl.atomic_add(values + low + C, fu * (1.0 - fv) * d, mask=mask, sem="relaxed")
    tl.atomic_add(values + high, (1.0 - fu) * fv * d, mask=mask, sem="relaxed")
    tl.atomic_add(values + high + C, fu * fv * d, mask=mask, sem="relaxed")
    chunk = tl.arange(0, C // 8)[None, :]  # two vertices of C / 16 chunks
    one = tl.full([u.shape[0], C // 8], 1, tl.uint8)
    tl.store(touched + (o00 // 16)[:, None] + chunk, one, mask=mask)
    tl.store(touched + (o10 // 16)[:, None] + chunk, one, mask=mask)


@triton.jit
def plane_corners(ints, plane, inv_cell, u, v, C: tl.constexpr):
    """Offsets of the two rows of a cell [B] and the fractions in it [B], clamped to the border."""
    row = ints + PLANES + 5 * plane
    offset = tl.load(row)
    n_u = tl.load(row + 3)
    i, fu = _cell(u, inv_cell, tl.load(row + 1), n_u)
    j, fv = _cell(v, inv_cell, tl.load(row + 2), tl.load(row + 4))
    o00 = tl.multiple_of(offset, 16) + (j * n_u + i) * C
    return o00, o00 + n_u * C, fu, fv


@triton.jit
def _cell(x, inv_cell, first, n):
    last = first + n - 1
    g = tl.minimum(tl.maximum(x * inv_cell, first.to(tl.float32)), last.to(tl.float32))
    i = tl.minimum(tl.floor(g).to(tl.int32), last - 1)
    return i, g - i.to(tl.float32)
