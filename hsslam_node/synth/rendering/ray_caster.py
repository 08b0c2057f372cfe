"""Numba kernels: primitives into screen tiles, nearest hit per pixel, texture coordinates."""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.synth.rendering.face_borders import mix_borders
from hsslam_node.synth.rendering.texture_lookup import JIT, look_up_of, sample
from hsslam_node.synth.rendering.tile_binning import NEAR_M, TILE, bin_primitives

_PIXELS = TILE * TILE
_SHIFT = 4  # log2 of TILE
_SHARPNESS = 0.8  # footprint of a pixel for the choice of mip levels, in pixels
_EPSILON = np.float32(1e-9)  # keeps 1 / direction finite
_LEAST_COSINE = np.float32(0.08)


@njit(**JIT)
def render(kinds, rotations, centers, halves, first_faces, first_levels, inverse_texels, levels,
           texels, T, intrinsics, color, depth, units_per_m, packed, face_ids):  # fmt: skip
    """Renders colour [H, W, 3] uint8 and planar depth [H, W] uint16 seen from T [4, 4] (camera to
    world).

    kinds, first_faces [P] int32; rotations [P, 3, 3], centers, halves [P, 3] float64.
    first_levels, inverse_texels, levels and texels as in `sample`.
    intrinsics [4] fx fy cx cy; packed [H, W] uint32, face_ids [H, W] int32: scratch.
    """
    height, width = depth.shape
    to_unit, origins = _into_unit_frames(rotations, centers, halves, T)
    counts, members, closest = bin_primitives(
        rotations, centers, halves, T, intrinsics, height, width
    )
    ray_x, ray_y = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.float32)
    nearest, owner = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.int32)
    s, q = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.float32)
    slant, face = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.int32)
    hit = np.empty(len(kinds), np.int32)
    look, width_m = look_up_of(_PIXELS), np.empty(_PIXELS, np.float32)
    colors = np.empty(_PIXELS, np.uint32)
    pixel = np.float32(_SHARPNESS / intrinsics[0])
    scale = np.float32(units_per_m)
    tiles_x = (width + TILE - 1) // TILE
    for tile in range(len(counts)):
        row, column = TILE * (tile // tiles_x), TILE * (tile % tiles_x)
        for i in range(_PIXELS):
            ray_x[i] = (column + (i & (TILE - 1)) - intrinsics[2]) / intrinsics[0]
            ray_y[i] = (row + (i >> _SHIFT) - intrinsics[3]) / intrinsics[1]
            nearest[i] = np.float32(1e6)
            owner[i] = 0
        hits, farthest = 0, np.float32(1e6)
        for k in range(counts[tile]):
            p = members[tile, k]
            if closest[p] > farthest:
                break  # all others are behind what this tile shows
            M, o = to_unit[p], origins[p]
            if kinds[p] <= 1:
                is_hit = _hit_cube(p, kinds[p] == 0, M, o, ray_x, ray_y, nearest, owner)
            elif kinds[p] == 2:
                is_hit = _hit_cylinder(p, M, o, ray_x, ray_y, nearest, owner)
            else:
                is_hit = _hit_ball(p, M, o, ray_x, ray_y, nearest, owner)
            if is_hit:
                hit[hits] = p
                hits += 1
                farthest = nearest.max()
        for k in range(hits):
            p = hit[k]
            if not _is_seen(p, owner):
                continue  # what it hit, others hide
            M, o, h, first = to_unit[p], origins[p], halves[p], first_faces[p]
            if kinds[p] <= 1:
                _place_on_cube(p, first, M, o, h, ray_x, ray_y, nearest, owner, face, s, q, slant)
            else:
                round_ = kinds[p] == 3
                _place_on_round(
                    p, first, round_, M, o, ray_x, ray_y, nearest, owner, face, s, q, slant
                )
        for i in range(_PIXELS):
            width_m[i] = nearest[i] * pixel
        sample(
            texels, levels, first_levels, inverse_texels, face, s, q, width_m, slant, look, colors
        )
        for y in range(min(TILE, height - row)):
            for x in range(min(TILE, width - column)):
                i, v, u = y * TILE + x, row + y, column + x
                packed[v, u] = colors[i]
                face_ids[v, u] = face[i]
                units = nearest[i] * scale + np.float32(0.5)
                depth[v, u] = np.uint16(min(units, np.float32(65535)))
    mix_borders(packed, face_ids, color)


@njit(**JIT)
def _into_unit_frames(rotations, centers, halves, T):
    """Camera rays into the unit frame of every primitive: matrices [P, 3, 3] and origins [P, 3]."""
    n = len(centers)
    to_unit, origins = np.empty((n, 3, 3), np.float32), np.empty((n, 3), np.float32)
    for p in range(n):
        for a in range(3):
            o = 0.0
            for i in range(3):
                o += rotations[p, i, a] * (T[i, 3] - centers[p, i])
            origins[p, a] = o / halves[p, a]
            for b in range(3):
                m = 0.0
                for i in range(3):
                    m += rotations[p, i, a] * T[i, b]
                to_unit[p, a, b] = m / halves[p, a]
    return to_unit, origins


@njit(**JIT)
def _hit_cube(p, inside, M, o, ray_x, ray_y, nearest, owner):
    hits = np.int32(0)
    for i in range(_PIXELS):
        ix = np.float32(1) / (M[0, 0] * ray_x[i] + M[0, 1] * ray_y[i] + M[0, 2] + _EPSILON)
        iy = np.float32(1) / (M[1, 0] * ray_x[i] + M[1, 1] * ray_y[i] + M[1, 2] + _EPSILON)
        iz = np.float32(1) / (M[2, 0] * ray_x[i] + M[2, 1] * ray_y[i] + M[2, 2] + _EPSILON)
        mx, my, mz = -o[0] * ix, -o[1] * iy, -o[2] * iz
        kx, ky, kz = abs(ix), abs(iy), abs(iz)
        enter = max(max(mx - kx, my - ky), mz - kz)
        leave = min(min(mx + kx, my + ky), mz + kz)
        t = leave if inside else enter
        before = (t < nearest[i]) | ((t == nearest[i]) & (p < owner[i]))
        hit = (enter <= leave) & (t > np.float32(NEAR_M)) & before
        nearest[i] = t if hit else nearest[i]
        owner[i] = p if hit else owner[i]
        hits += np.int32(hit)
    return hits > 0


@njit(**JIT)
def _hit_ball(p, M, o, ray_x, ray_y, nearest, owner):
    hits = np.int32(0)
    c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - np.float32(1)
    for i in range(_PIXELS):
        dx = M[0, 0] * ray_x[i] + M[0, 1] * ray_y[i] + M[0, 2]
        dy = M[1, 0] * ray_x[i] + M[1, 1] * ray_y[i] + M[1, 2]
        dz = M[2, 0] * ray_x[i] + M[2, 1] * ray_y[i] + M[2, 2]
        a = dx * dx + dy * dy + dz * dz
        b = dx * o[0] + dy * o[1] + dz * o[2]
        root = b * b - a * c
        t = (-b - np.sqrt(max(root, np.float32(0)))) / a
        before = (t < nearest[i]) | ((t == nearest[i]) & (p < owner[i]))
        hit = (root > np.float32(0)) & (t > np.float32(NEAR_M)) & before
        nearest[i] = t if hit else nearest[i]
        owner[i] = p if hit else owner[i]
        hits += np.int32(hit)
    return hits > 0


@njit(**JIT)
def _hit_cylinder(p, M, o, ray_x, ray_y, nearest, owner):
    hits = np.int32(0)
    c = o[0] * o[0] + o[1] * o[1] - np.float32(1)
    for i in range(_PIXELS):
        dx = M[0, 0] * ray_x[i] + M[0, 1] * ray_y[i] + M[0, 2]
        dy = M[1, 0] * ray_x[i] + M[1, 1] * ray_y[i] + M[1, 2]
        iz = np.float32(1) / (M[2, 0] * ray_x[i] + M[2, 1] * ray_y[i] + M[2, 2] + _EPSILON)
        a = dx * dx + dy * dy + _EPSILON
        b = dx * o[0] + dy * o[1]
        root = b * b - a * c
        width = np.sqrt(max(root, np.float32(0)))
        enter = max((-b - width) / a, -o[2] * iz - abs(iz))
        leave = min((-b + width) / a, -o[2] * iz + abs(iz))
        hit = (root > np.float32(0)) & (enter <= leave)
        before = (enter < nearest[i]) | ((enter == nearest[i]) & (p < owner[i]))
        hit = hit & (enter > np.float32(NEAR_M)) & before
        nearest[i] = enter if hit else nearest[i]
        owner[i] = p if hit else owner[i]
        hits += np.int32(hit)
    return hits > 0


@njit(**JIT)
def _is_seen(p, owner):
    pixels = np.int32(0)
    for i in range(_PIXELS):
        pixels += np.int32(owner[i] == p)
    return pixels > 0


@njit(**JIT)
def _place_on_cube(p, first, M, o, half, ray_x, ray_y, nearest, owner, face, s, q, slant):
    """Face, texture coordinates in [0, 1], slant (growth of a pixel's footprint); no branches."""
    hx, hy, hz = np.float32(half[0]), np.float32(half[1]), np.float32(half[2])
    one, scale = np.float32(1), np.float32(0.5)
    for i in range(_PIXELS):
        mine, t = owner[i] == p, nearest[i]
        dx = M[0, 0] * ray_x[i] + M[0, 1] * ray_y[i] + M[0, 2]
        dy = M[1, 0] * ray_x[i] + M[1, 1] * ray_y[i] + M[1, 2]
        dz = M[2, 0] * ray_x[i] + M[2, 1] * ray_y[i] + M[2, 2]
        x, y, z = o[0] + t * dx, o[1] + t * dy, o[2] + t * dz
        ax, ay, az = abs(x), abs(y), abs(z)
        on_x = (ax >= ay) & (ax >= az)
        on_y = ay >= az
        along = x if on_x else (y if on_y else z)
        toward = dx * hx if on_x else (dy * hy if on_y else dz * hz)
        number = 0 if on_x else (2 if on_y else 4)
        across = y if on_x else x
        up = z if on_x | on_y else y
        length = np.sqrt(ray_x[i] * ray_x[i] + ray_y[i] * ray_y[i] + one)
        cosine = max(abs(toward) / length, _LEAST_COSINE)
        f = first + number + (0 if along > 0 else 1)
        face[i] = np.int32(f) if mine else face[i]
        s[i] = (across + one) * scale if mine else s[i]
        q[i] = (one - up) * scale if mine else q[i]
        slant[i] = one / np.sqrt(cosine) if mine else slant[i]


@njit(**JIT)
def _place_on_round(p, first, is_ball, M, o, ray_x, ray_y, nearest, owner, face, s, q, slant):
    """The same for cylinders and ellipsoids; few pixels, so with branches."""
    one, scale, turn = np.float32(1), np.float32(0.5), np.float32(0.5 / np.pi)
    for i in range(_PIXELS):
        if owner[i] != p:
            continue
        t = nearest[i]
        x = o[0] + t * (M[0, 0] * ray_x[i] + M[0, 1] * ray_y[i] + M[0, 2])
        y = o[1] + t * (M[1, 0] * ray_x[i] + M[1, 1] * ray_y[i] + M[1, 2])
        z = o[2] + t * (M[2, 0] * ray_x[i] + M[2, 1] * ray_y[i] + M[2, 2])
        slant[i] = one
        if not is_ball and x * x + y * y < z * z:  # a cap
            face[i] = np.int32(first + (1 if z > 0 else 2))
            s[i], q[i] = (x + one) * scale, (one - y) * scale
            continue
        face[i] = np.int32(first)
        s[i] = np.arctan2(y, x) * turn + scale
        z = min(max(z, -one), one)
        q[i] = np.arccos(z) * np.float32(2) * turn if is_ball else (one - z) * scale
