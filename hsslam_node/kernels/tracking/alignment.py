"""Normal equations of dense alignment: depth points to the SDF and to a keyframe's surface, and pixels
of a keyframe to the image.

Twin of `add_sdf_term`: `gpu_kernels/tracking/alignment.py`. The other terms run on the CPU only.

Every kernel linearises about T_world_cam and adds to an 8x8 system in (translation m, rotation rad,
grey bias, gain): the pose moves as t <- t + rho, R <- exp(omega) R, both in world axes, so rotation is
about the camera centre. H [8, 8], b [8] float64 with H x = -b.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_sdf_term(
    sdf, gradient, inside, world, z, centre, truncation_m, sigma_m, sigma_slope, huber_m, H, b
):
    """Points on the zero level: residual T phi, weight 1 / sigma(z)^2, Huber; |phi| > 0.95 is an outlier.

    sdf [N], gradient [N, 3] (T/m), world [N, 3] m, z [N] m planar depth, centre [3] m. Returns
    (weighted squared error, inliers, points in the bound, sum of squared inlier residuals m^2).
    """
    cost = 0.0
    squares = 0.0
    inliers = 0
    seen = 0
    J = np.empty(6)
    for k in range(sdf.shape[0]):
        if not inside[k]:
            continue
        seen += 1
        if abs(sdf[k]) > 0.95:
            continue
        r = sdf[k] * truncation_m
        far = max(z[k] - 0.4, 0.0)
        sigma = sigma_m + sigma_slope * far * far
        w = 1.0 / (sigma * sigma)
        size = abs(r)
        if size > huber_m:
            cost += w * huber_m * (2.0 * size - huber_m)
            w *= huber_m / size
        else:
            cost += w * r * r
            squares += r * r
            inliers += 1
        _fill_point_row(gradient[k], truncation_m, world[k], centre, J)
        _add_row(J, r, w, H, b)
    return cost, inliers, seen, squares


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_keyframe_surface_term(
    points, world, centre, T_key_world, key_points, key_normals, K, sigma_m, noise, noise_share,
    reach, inlier_m, gate_m, H, b,
):  # fmt: skip
    """Points [N, 3] (world) to the tangent planes of a keyframe's surface (projective association).

    key_points, key_normals [h, w, 3] (m, keyframe camera; normal 0 = none), K [4] of that resolution.
    The deviation of a residual r is sigma = sigma_m + noise z^2 (noise in 1/m, of inverse depth); its cost
    is that of Geman and McClure, weight r^2 / (1 + (r / (reach sigma))^2): residuals of many sigma, from
    moving objects or wrong pairs, hardly count. The weight is 1 / sigma^2 with noise_share of the noise.
    Returns (cost, residuals below inlier_m, points that overlap the surface).
    """
    height, width = key_points.shape[0], key_points.shape[1]
    cost = 0.0
    inliers = 0
    met = 0
    J = np.empty(6)
    n_world = np.empty(3)
    for k in range(world.shape[0]):
        x = _row(T_key_world, 0, world[k])
        y = _row(T_key_world, 1, world[k])
        z = _row(T_key_world, 2, world[k])
        if z <= 0.1:
            continue
        u = int(K[0] * x / z + K[2] + 0.5)
        v = int(K[1] * y / z + K[3] + 0.5)
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        n = key_normals[v, u]
        if n[0] == 0 and n[1] == 0 and n[2] == 0:
            continue
        q = key_points[v, u]
        r = n[0] * (x - q[0]) + n[1] * (y - q[1]) + n[2] * (z - q[2])
        if abs(r) > gate_m or abs(z - q[2]) > 3.0 * gate_m:
            continue
        met += 1
        deep = max(z, np.float64(points[k, 2]))
        sigma = sigma_m + noise * deep * deep
        share = 1.0 / (1.0 + r * r / (reach * reach * sigma * sigma))
        sigma = sigma_m + noise_share * noise * deep * deep
        w = 1.0 / (sigma * sigma)
        cost += w * r * r * share
        w *= share * share
        if abs(r) <= inlier_m:
            inliers += 1
        for a in range(3):
            n_world[a] = (
                T_key_world[0, a] * n[0] + T_key_world[1, a] * n[1] + T_key_world[2, a] * n[2]
            )
        _fill_point_row(n_world, 1.0, world[k], centre, J)
        _add_row(J, r, w, H, b)
    return cost, inliers, met


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_photometric_term(
    grey, depth, depth_step, K, key_world, key_grey, T_world_cam, bias, gain, sigma, huber, H, b
):  # fmt: skip
    """Keyframe pixels key_world [N, 3] (m, world) with grey level key_grey [N] against an image.

    grey [h, w] float32 0..255, depth [h, w] float32 m of the same resolution (0 = unknown), K [4]. Pixels
    whose depth differs by more than the share depth_step are hidden and do not count. The image is gain
    times the keyframe plus bias, columns 7 and 6 of the system. Returns (weighted squared error, inliers,
    pixels in view).
    """
    height, width = grey.shape
    cost = 0.0
    inliers = 0
    seen = 0
    J = np.empty(8)
    d = np.empty(3)
    weight = 1.0 / (sigma * sigma)
    for k in range(key_world.shape[0]):
        for a in range(3):
            d[a] = key_world[k, a] - T_world_cam[a, 3]
        x = T_world_cam[0, 0] * d[0] + T_world_cam[1, 0] * d[1] + T_world_cam[2, 0] * d[2]
        y = T_world_cam[0, 1] * d[0] + T_world_cam[1, 1] * d[1] + T_world_cam[2, 1] * d[2]
        z = T_world_cam[0, 2] * d[0] + T_world_cam[1, 2] * d[1] + T_world_cam[2, 2] * d[2]
        if z <= 0.1:
            continue
        u = K[0] * x / z + K[2]
        v = K[1] * y / z + K[3]
        if u < 1.0 or v < 1.0 or u >= width - 2.0 or v >= height - 2.0:
            continue
        i = int(u)
        j = int(v)
        measured = depth[j, i]
        if measured > 0 and abs(measured - z) > depth_step * z:
            continue
        seen += 1
        fu = u - i
        fv = v - j
        g00 = grey[j, i]
        g01 = grey[j, i + 1]
        g10 = grey[j + 1, i]
        g11 = grey[j + 1, i + 1]
        value = (g00 * (1 - fu) + g01 * fu) * (1 - fv) + (g10 * (1 - fu) + g11 * fu) * fv
        du = (g01 - g00) * (1 - fv) + (g11 - g10) * fv
        dv = (g10 - g00) * (1 - fu) + (g11 - g01) * fu
        r = value - bias - gain * key_grey[k]
        w = weight
        size = abs(r)
        if size > huber:
            cost += w * huber * (2.0 * size - huber)
            w *= huber / size
        else:
            cost += w * r * r
            inliers += 1
        jx = du * K[0] / z
        jy = dv * K[1] / z
        jz = -(jx * x + jy * y) / z
        # dx_cam = -R^T rho + R^T (d x omega)
        a0 = T_world_cam[0, 0] * jx + T_world_cam[0, 1] * jy + T_world_cam[0, 2] * jz
        a1 = T_world_cam[1, 0] * jx + T_world_cam[1, 1] * jy + T_world_cam[1, 2] * jz
        a2 = T_world_cam[2, 0] * jx + T_world_cam[2, 1] * jy + T_world_cam[2, 2] * jz
        J[0] = -a0
        J[1] = -a1
        J[2] = -a2
        J[3] = a1 * d[2] - a2 * d[1]
        J[4] = a2 * d[0] - a0 * d[2]
        J[5] = a0 * d[1] - a1 * d[0]
        J[6] = -1.0
        J[7] = -key_grey[k]
        _add_row(J, r, w, H, b)
    return cost, inliers, seen


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _row(T, a, p):
    return T[a, 0] * p[0] + T[a, 1] * p[1] + T[a, 2] * p[2] + T[a, 3]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _fill_point_row(g, scale, p, centre, J):
    """Row of a residual whose gradient by the point is scale * g: (g, (p - centre) x g)."""
    for a in range(3):
        J[a] = scale * g[a]
    dx = p[0] - centre[0]
    dy = p[1] - centre[1]
    dz = p[2] - centre[2]
    J[3] = dy * J[2] - dz * J[1]
    J[4] = dz * J[0] - dx * J[2]
    J[5] = dx * J[1] - dy * J[0]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _add_row(J, r, w, H, b):
    for i in range(J.shape[0]):
        wj = w * J[i]
        b[i] += wj * r
        for k in range(i, J.shape[0]):
            H[i, k] += wj * J[k]
