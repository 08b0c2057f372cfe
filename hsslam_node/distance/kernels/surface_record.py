"""What a voxel keeps of the surface in it, in 8 bytes: its place, from hits, and its plane, from neighbours.

Of int8 [nz, ny, nx, 8], the last axis is

| | |
|---|---|
| 0 to 2 | mean place of the surface from the voxel's middle (x, y, z), in 1 / `STEPS` voxels |
| 3 | weight of that mean: the sum of the weights of its hits, at most 120 |
| 4 to 6 | normal of the plane through the places about it, towards the cameras, times `UNIT` |
| 7 | height of that plane above the voxel's middle, along the normal, in 1 / `STEPS` voxels |
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

WEIGHT, NORMAL, HEIGHT = 3, 4, 7
STEPS = 100.0
UNIT = 127.0
_FEWEST = 4  # places that make a plane
_UNEVEN = 0.25  # voxels, from the plane to the voxel's own place
_TRUSTED = 100.0
_EVEN = 0.02  # voxels^2, added to the spread of the places: fewer wrinkles


@njit(cache=True, nogil=True, error_model="numpy")
def fit_plane(evidence, surface, i, j, k, least, ray):
    """Fit the plane of a voxel to its place and those of its 26 neighbours, by weighted least squares.

    With too few neighbours it faces the camera.

    Args:
        evidence: [nz, ny, nx] int8.
        surface: records.
        least: evidence from which on a voxel counts.
        ray: [3] from the voxel to the camera, any length.
    """
    nz, ny, nx = evidence.shape
    count = 0
    w = x = y = z = xx = xy = xz = yy = yz = zz = 0.0
    for c in range(max(k - 1, 0), min(k + 2, nz)):
        for b in range(max(j - 1, 0), min(j + 2, ny)):
            for a in range(max(i - 1, 0), min(i + 2, nx)):
                if evidence[c, b, a] < least:
                    continue
                record = surface[c, b, a]
                weight = float(record[WEIGHT])
                p = a - i + record[0] / STEPS
                q = b - j + record[1] / STEPS
                r = c - k + record[2] / STEPS
                count += 1
                w += weight
                x += weight * p
                y += weight * q
                z += weight * r
                xx += weight * p * p
                xy += weight * p * q
                xz += weight * p * r
                yy += weight * q * q
                yz += weight * q * r
                zz += weight * r * r
    record = surface[k, j, i]
    length = np.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
    n0, n1, n2 = ray[0] / length, ray[1] / length, ray[2] / length
    if count < _FEWEST:
        x, y, z = record[0] / STEPS, record[1] / STEPS, record[2] / STEPS
    else:
        x, y, z = x / w, y / w, z / w
        xx, xy, xz = xx / w - x * x + _EVEN, xy / w - x * y, xz / w - x * z
        yy, yz, zz = yy / w - y * y + _EVEN, yz / w - y * z, zz / w - z * z + _EVEN
        a00, a01, a02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy  # the adjugate
        a11, a12, a22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        for _ in range(3):  # turns towards the direction of the least spread
            m0 = a00 * n0 + a01 * n1 + a02 * n2
            m1 = a01 * n0 + a11 * n1 + a12 * n2
            m2 = a02 * n0 + a12 * n1 + a22 * n2
            length = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2) + 1e-12
            n0, n1, n2 = m0 / length, m1 / length, m2 / length
    record[NORMAL] = np.int8(np.rint(UNIT * n0))
    record[NORMAL + 1] = np.int8(np.rint(UNIT * n1))
    record[NORMAL + 2] = np.int8(np.rint(UNIT * n2))
    height = STEPS * (x * n0 + y * n1 + z * n2)
    own = record[0] * n0 + record[1] * n1 + record[2] * n2
    if abs(own - height) > _UNEVEN * STEPS and record[WEIGHT] >= _TRUSTED:  # it is no plane
        height = own
    record[HEIGHT] = np.int8(np.rint(min(max(height, -UNIT), UNIT)))
