"""Distance of points to triangles."""

import numba
import numpy as np


@numba.njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def point_to_triangle_distances(points, triangles, candidates):
    """Least distance [N] of points [N, 3] to the triangles [M, 3, 3] that candidates [N, k] names.

    Closest point by Voronoi regions (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
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
    d1 = ab0 * ap0 + ab1 * ap1 + ab2 * ap2
    d2 = ac0 * ap0 + ac1 * ap1 + ac2 * ap2
    abab = ab0 * ab0 + ab1 * ab1 + ab2 * ab2
    abac = ab0 * ac0 + ab1 * ac1 + ab2 * ac2
    acac = ac0 * ac0 + ac1 * ac1 + ac2 * ac2
    d3, d4 = d1 - abab, d2 - abac
    d5, d6 = d1 - abac, d2 - acac
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / max(d1 - d3, 1e-300), 0.0
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / max(d2 - d6, 1e-300)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        v = 1.0 - w
    else:
        total = max(va + vb + vc, 1e-300)
        v, w = vb / total, vc / total
    r0 = ap0 - v * ab0 - w * ac0
    r1 = ap1 - v * ab1 - w * ac1
    r2 = ap2 - v * ab2 - w * ac2
    return r0 * r0 + r1 * r1 + r2 * r2
