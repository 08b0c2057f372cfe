"""Rays of a mapping batch: pixels of a keyframe, their samples, and the gradient by the poses.

Twin: `gpu_kernels/mapping/ray_batch.py`. Reference of the samples: `rendering/ray_sampling.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.depth_mean import mean_depth


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def gather_pixels(
    color, depth_raw, metres_per_unit, max_depth_m, K, uv, radius_px, same_surface, blind, slot, rays,
    first, wanted,
):  # fmt: skip
    """Take the first `wanted` candidates with depth, or if `blind` with or without; returns their number.

    color [H, W, 3] uint8, depth_raw [H, W] uint16, K [4] = fx, fy, cx, cy, uv [N, 2] px. Writes into
    `rays` (`RayBatch` arrays: direction [R, 3] with z = 1, depth [R] m, color [R, 3] 0..1, slot [R])
    from row `first` on. Candidates beyond `max_depth_m` are skipped; depth 0 is none. The depth is the
    `mean_depth` around the pixel, or its own if `same_surface` is 0.
    """
    found = 0
    for k in range(uv.shape[0]):
        if found == wanted:
            break
        u = uv[k, 0]
        v = uv[k, 1]
        d = np.float32(depth_raw[v, u]) * np.float32(metres_per_unit)
        if d > max_depth_m or (d <= 0.0 and not blind):
            continue
        r = first + found
        rays.direction[r, 0] = (np.float32(u) - K[2]) / K[0]
        rays.direction[r, 1] = (np.float32(v) - K[3]) / K[1]
        rays.direction[r, 2] = np.float32(1.0)
        if same_surface > 0.0 and d > 0.0:
            d = mean_depth(depth_raw, u, v, metres_per_unit, radius_px, same_surface)
        rays.depth[r] = d
        for c in range(3):
            rays.color[r, c] = np.float32(color[v, u, c]) * np.float32(1.0 / 255.0)
        rays.slot[r] = slot
        found += 1
    return found


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def place_samples(
    rays,
    n_rays,
    poses,
    jitter,
    free_samples,
    surface_samples,
    free_reach,
    surface_half_m,
    z,
    points,
):
    """Sample depths z [R, S] m, sorted near to far, and points [R * S, 3] m, world.

    poses [slots, 3, 4] float32 T_world_cam; jitter [R, S] in 0..1 places each sample within its
    stratum (rendering/ray_sampling.py: free strata over [0, reach D], surface strata over D +- half;
    a ray without measurement, whose depth is -far, has all strata over [0, far]).
    """
    S = free_samples + surface_samples
    for r in range(n_rays):
        D = rays.depth[r]
        for s in range(S):
            if D < 0.0:
                value = (np.float32(s) + jitter[r, s]) / np.float32(S) * -D
            elif s < free_samples:
                t = (np.float32(s) + jitter[r, s]) / np.float32(free_samples)
                value = t * free_reach * D
            else:
                t = (np.float32(s - free_samples) + jitter[r, s]) / np.float32(surface_samples)
                value = max(
                    D + (np.float32(2.0) * t - np.float32(1.0)) * surface_half_m, np.float32(0.0)
                )
            k = s
            while k > 0 and z[r, k - 1] > value:
                z[r, k] = z[r, k - 1]
                k -= 1
            z[r, k] = value
        pose = poses[rays.slot[r]]
        for a in range(3):
            along = (
                pose[a, 0] * rays.direction[r, 0] + pose[a, 1] * rays.direction[r, 1] + pose[a, 2]
            )
            for s in range(S):
                points[r * S + s, a] = pose[a, 3] + along * z[r, s]


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def pose_gradients(rays, n_rays, poses, z, d_points, d_twist):
    """Add the loss gradient by a world-side twist of each pose to d_twist [slots, 6] (1/m, 1/rad).

    The pose moves as T <- exp(xi) about the camera centre: translation in world axes, rotation in
    world axes about the camera's position. d_points [R * S, 3].
    """
    S = z.shape[1]
    for r in range(n_rays):
        slot = rays.slot[r]
        pose = poses[slot]
        along = np.empty(3, np.float32)
        for a in range(3):
            along[a] = (
                pose[a, 0] * rays.direction[r, 0] + pose[a, 1] * rays.direction[r, 1] + pose[a, 2]
            )
        force = np.zeros(3, np.float32)
        lever = np.zeros(3, np.float32)
        for s in range(S):
            for a in range(3):
                force[a] += d_points[r * S + s, a]
                lever[a] += z[r, s] * d_points[r * S + s, a]
        for a in range(3):
            d_twist[slot, a] += force[a]
        d_twist[slot, 3] += along[1] * lever[2] - along[2] * lever[1]
        d_twist[slot, 4] += along[2] * lever[0] - along[0] * lever[2]
        d_twist[slot, 5] += along[0] * lever[1] - along[1] * lever[0]
