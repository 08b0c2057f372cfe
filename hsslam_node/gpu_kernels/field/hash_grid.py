"""Multi-resolution hash grid on the GPU: trilinear gather, its scatter, its derivative by position.

Twin: `kernels/field/hash_grid.py`.

Device functions over a block of B points with positions x, y, z [B] (m, from vertex (0, 0, 0))
and all levels at once: tiles are [B, LP], LP the levels rounded up. A level has two features.
"""

import triton
import triton.language as tl

from hsslam_node.gpu_kernels.field.layout import LEVELS, SCALES


@triton.jit
def gather_hash(params, ints, floats, x, y, z, live, L: tl.constexpr, LP: tl.constexpr):
    """First and second feature of all levels, two tiles [B, LP]; 0 beyond L and if not `live`."""
    first, mask, scale, on = _levels(ints, floats, L, LP)
    on = on & live[:, None]
    ix, fx, n_x = _cell(ints, x, scale, 0, L, LP)
    iy, fy, n_y = _cell(ints, y, scale, 1, L, LP)
    iz, fz, _ = _cell(ints, z, scale, 2, L, LP)
    f0 = tl.zeros_like(fx)
    f1 = tl.zeros_like(fx)
    for corner in tl.static_range(8):
        o = _vertex(first, mask, n_x, n_y, ix, iy, iz, corner)
        w = _weight(fx, fy, fz, corner)
        f0 += w * tl.load(params + o, mask=on, other=0.0)
        f1 += w * tl.load(params + o + 1, mask=on, other=0.0)
    return f0, f1


@triton.jit
def scatter_hash(
    values, touched, ints, floats, x, y, z, live, d0, d1, L: tl.constexpr, LP: tl.constexpr
):
    """Add the gradient by the features of `gather_hash` and mark the 16-float chunks that it touches."""
    first, mask, scale, on = _levels(ints, floats, L, LP)
    on = on & live[:, None]
    ix, fx, n_x = _cell(ints, x, scale, 0, L, LP)
    iy, fy, n_y = _cell(ints, y, scale, 1, L, LP)
    iz, fz, _ = _cell(ints, z, scale, 2, L, LP)
    one = tl.full([x.shape[0], LP], 1, tl.uint8)
    for corner in tl.static_range(8):
        o = _vertex(first, mask, n_x, n_y, ix, iy, iz, corner)
        w = _weight(fx, fy, fz, corner)
        tl.atomic_add(values + o, w * d0, mask=on, sem="relaxed")
        tl.atomic_add(values + o + 1, w * d1, mask=on, sem="relaxed")
        tl.store(touched + o // 16, one, mask=on)


@triton.jit
def hash_position_gradient(
    params, ints, floats, x, y, z, live, d0, d1, L: tl.constexpr, LP: tl.constexpr
):
    """d(loss)/d(position) as three [B] (1/m) from the gradient by the features of `gather_hash`."""
    first, mask, scale, on = _levels(ints, floats, L, LP)
    on = on & live[:, None]
    ix, fx, n_x = _cell(ints, x, scale, 0, L, LP)
    iy, fy, n_y = _cell(ints, y, scale, 1, L, LP)
    iz, fz, _ = _cell(ints, z, scale, 2, L, LP)
    dx = tl.zeros_like(fx)
    dy = tl.zeros_like(fx)
    dz = tl.zeros_like(fx)
    for corner in tl.static_range(8):
        o = _vertex(first, mask, n_x, n_y, ix, iy, iz, corner)
        value = d0 * tl.load(params + o, mask=on, other=0.0)
        value += d1 * tl.load(params + o + 1, mask=on, other=0.0)
        wx = _side(fx, corner & 1)
        wy = _side(fy, corner // 2 & 1)
        wz = _side(fz, corner // 4)
        dx += value * wy * wz if corner & 1 else -value * wy * wz
        dy += value * wx * wz if corner // 2 & 1 else -value * wx * wz
        dz += value * wx * wy if corner // 4 else -value * wx * wy
    return tl.sum(scale * dx, axis=1), tl.sum(scale * dy, axis=1), tl.sum(scale * dz, axis=1)


@triton.jit
def _levels(ints, floats, L: tl.constexpr, LP: tl.constexpr):
    """Offset of each level's vertex (0, 0, 0) (dense) or table, hash mask (0: dense), cells per metre,
    and which levels exist: [1, LP]."""
    level = tl.arange(0, LP)
    on = level < L
    first = tl.load(ints + LEVELS + level, mask=on, other=0)
    mask = tl.load(ints + LEVELS + L + level, mask=on, other=0)
    scale = tl.load(floats + SCALES + level, mask=on, other=0.0)
    return first[None, :], mask[None, :], scale[None, :], on[None, :]


@triton.jit
def _cell(ints, x, scale, axis: tl.constexpr, L: tl.constexpr, LP: tl.constexpr):
    """Lower vertex, counted from the origin, and fraction along one axis, [B, LP]; vertices along it."""
    level = tl.arange(0, LP)
    on = level < L
    first = tl.load(ints + LEVELS + (2 + axis) * L + level, mask=on, other=0)[None, :]
    count = tl.load(ints + LEVELS + (5 + axis) * L + level, mask=on, other=2)[None, :]
    g = tl.maximum(x[:, None] * scale, first.to(tl.float32))
    i = tl.minimum(tl.floor(g).to(tl.int32), first + count - 2)
    return i, g - i.to(tl.float32), count


@triton.jit
def _vertex(first, mask, n_x, n_y, ix, iy, iz, corner: tl.constexpr):
    """Offset in floats of a vertex (x fastest): dense, or XOR hash (Instant-NGP, eq. 4)."""
    vx = ix + (corner & 1)
    vy = iy + (corner // 2 & 1)
    vz = iz + corner // 4
    dense = vx + n_x * (vy + n_y * vz)
    # only the low bits count: the products may wrap around
    hy = tl.mul(vy.to(tl.uint32), 2654435761, sanitize_overflow=False)
    hz = tl.mul(vz.to(tl.uint32), 805459861, sanitize_overflow=False)
    hashed = (vx.to(tl.uint32) ^ hy ^ hz).to(tl.int32, bitcast=True) & mask
    return first + 2 * tl.where(mask == 0, dense, hashed)


@triton.jit
def _weight(fx, fy, fz, corner: tl.constexpr):
    return _side(fx, corner & 1) * _side(fy, corner // 2 & 1) * _side(fz, corner // 4)


@triton.jit
def _side(f, upper: tl.constexpr):
    return f if upper else 1.0 - f
