"""Distance of points to triangles."""

import numba
import numpy as np


@numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def point_to_triangle_distances(points, triangles, candidates):
    """Least distance [N] of points [N, 3] to the triangles [M, 3, 3] that candidates [N, k] names.

    Triangles may be degenerate: then their edges count.
    """
    out = np.empty(len(points))
    for i in range(len(points)):
        best = np.inf
        for k in range(candidates.shape[1]):
            t = triangles[candidates[i, k]]
            best = min(best, _squared_distance(points[i], t[0], t[1], t[2]))
        out[i] = np.sqrt(best)
    return out


@numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _squared_distance(p, a, b, c):
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ap0, ap1, ap2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    abab = ab0 * ab0 + ab1 * ab1 + ab2 * ab2
    abac = ab0 * ac0 + ab1 * ac1 + ab2 * ac2
    acac = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    abap = ab0 * ap0 + ab1 * ap1 + ab2 * ap2
    acap = ac0 * ap0 + ac1 * ap1 + ac2 * ap2
    area = abab * acac - abac * abac  # squared, of the parallelogram
    v, w = acac * abap - abac * acap, abab * acap - abac * abap
    if area > 1e-12 * abab * acac and v >= 0 and w >= 0 and v + w <= area:
        v, w = v / area, w / area
        r0 = ap0 - v * ab0 - w * ac0
        r1 = ap1 - v * ab1 - w * ac1
        r2 = ap2 - v * ab2 - w * ac2
        return r0 * r0 + r1 * r1 + r2 * r2
    return min(_to_segment(p, a, b), min(_to_segment(p, b, c), _to_segment(p, c, a)))


@numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _to_segment(p, a, b):
    along, length = 0.0, 0.0
    for i in range(3):
        along += (p[i] - a[i]) * (b[i] - a[i])
        length += (b[i] - a[i]) ** 2
    t = min(max(along / length, 0.0), 1.0) if length > 1e-24 else 0.0
    total = 0.0
    for i in range(3):
        total += (p[i] - a[i] - t * (b[i] - a[i])) ** 2
    return total
