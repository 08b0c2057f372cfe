"""Bakes the light of a room: soft lamps with shadows, and ambient light, dimmer in corners."""

import numpy as np

from hsslam_node.kernels.compiled import njit

_JIT = {"cache": True, "fastmath": True, "nogil": True, "error_model": "numpy"}
_LIFT_M = 0.004  # off the surface, so that it does not shadow itself
_AMBIENT_M = 0.9  # what is farther takes no ambient light
_SLACK_M = 1e-3  # for rounding


def light_samples(lamps_m: list[tuple[float, float, float]], seed: int) -> np.ndarray:
    """Points on the lamps [16 L, 3] m, world: level squares of 0.9 m about the given centres."""
    rng = np.random.default_rng((seed, 2))
    points = []
    for x, y, z in lamps_m:
        step = (np.indices((4, 4)).reshape(2, -1).T + rng.uniform(0, 1, (16, 2))) / 4 - 0.5
        points.append(np.column_stack([x + 0.9 * step[:, 0], y + 0.9 * step[:, 1], np.full(16, z)]))
    return np.concatenate(points)


@njit(**_JIT)
def bake_light(kinds, rotations, centers, halves, points, normals, lamps, directions):
    """Irradiance [N] float32 (about 1 in the open) at points [N, 3] with normals [N, 3].

    The first primitive, the shell, casts no shadow. lamps [16 L, 3] m, 16 points of each of L lamps;
    directions [D, 3]: cosine-weighted about +z, for the ambient part.
    """
    out = np.empty(len(points), np.float32)
    ray = np.empty(3)
    start = np.empty(3)
    ahead, near = np.empty(len(kinds), np.int64), np.empty(len(kinds), np.int64)
    spheres = np.empty((len(kinds), 5))
    for i in range(len(points)):
        n = normals[i]
        for a in range(3):
            start[a] = points[i, a] + _LIFT_M * n[a]
        others, neighbours = _in_reach(centers, halves, start, n, spheres, ahead, near)
        direct = 0.0
        for k in range(i % 2, len(lamps), 2):
            for a in range(3):
                ray[a] = lamps[k, a] - start[a]
            square = ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2
            cosine = (ray[0] * n[0] + ray[1] * n[1] + ray[2] * n[2]) / np.sqrt(square)
            emitted = max(ray[2] / np.sqrt(square), 0.0) * 0.75 + 0.25
            if cosine > 0 and not _blocked(
                kinds, rotations, centers, halves, spheres, ahead[:others], start, ray, 1.0
            ):
                direct += cosine * emitted / (square + 0.5)
        direct *= 2.0 / 32
        helper = 0 if abs(n[0]) < 0.6 else 1
        t1 = np.zeros(3)
        t1[helper] = 1.0
        t1 -= n[helper] * n
        t1 /= np.sqrt((t1**2).sum())
        t2 = np.array(
            [n[1] * t1[2] - n[2] * t1[1], n[2] * t1[0] - n[0] * t1[2], n[0] * t1[1] - n[1] * t1[0]]
        )
        turn = 2.399963 * i  # decorrelates neighbours; the smoothing averages it out
        c, s = np.cos(turn), np.sin(turn)
        open_ = 0.0
        for k in range(len(directions)):
            x = directions[k, 0] * c - directions[k, 1] * s
            y = directions[k, 0] * s + directions[k, 1] * c
            for a in range(3):
                ray[a] = x * t1[a] + y * t2[a] + directions[k, 2] * n[a]
            if not _blocked(
                kinds,
                rotations,
                centers,
                halves,
                spheres,
                near[:neighbours],
                start,
                ray,
                _AMBIENT_M,
            ):
                open_ += 1.0
        out[i] = 0.16 + 0.34 * open_ / len(directions) + 2.7 * direct
    return out


@njit(**_JIT)
def _in_reach(centers, halves, start, normal, spheres, ahead, near):
    """Write the primitives but the shell that rays from a surface can meet, and of these the near ones.

    `spheres` [P, 5] gets the bounding sphere of each: its middle less `start`, the square of this distance,
    and the square of its radius. Returns how many primitives lie ahead and how many are near.
    """
    others = neighbours = 0
    for p in range(1, len(centers)):
        height, distance_sq, reach_sq = 0.0, 0.0, 0.0
        for a in range(3):
            w = centers[p, a] - start[a]
            height += w * normal[a]
            distance_sq += w * w
            reach_sq += halves[p, a] ** 2
            spheres[p, a] = w
        spheres[p, 3], spheres[p, 4] = distance_sq, reach_sq
        reach = np.sqrt(reach_sq) + _SLACK_M
        if height < -reach:
            continue
        ahead[others] = p
        others += 1
        if distance_sq < (_AMBIENT_M + reach) ** 2:
            near[neighbours] = p
            neighbours += 1
    return others, neighbours


@njit(**_JIT)
def _blocked(kinds, rotations, centers, halves, spheres, primitives, start, ray, limit):
    """Whether one of these primitives lies on start + t ray for t in (0, limit)."""
    o, d = np.empty(3), np.empty(3)
    length_sq = ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2
    for p in primitives:
        toward = spheres[p, 0] * ray[0] + spheres[p, 1] * ray[1] + spheres[p, 2] * ray[2]
        t = min(max(toward / length_sq, 0.0), limit)
        if spheres[p, 3] - 2 * t * toward + t * t * length_sq > spheres[p, 4]:
            continue  # the bounding sphere is not touched
        for a in range(3):
            o[a], d[a] = 0.0, 1e-12
            for i in range(3):
                o[a] += rotations[p, i, a] * (start[i] - centers[p, i])
                d[a] += rotations[p, i, a] * ray[i]
            o[a] /= halves[p, a]
            d[a] /= halves[p, a]
        if kinds[p] == 1:
            enter, leave = -1e9, 1e9
            for a in range(3):
                middle, half = -o[a] / d[a], abs(1.0 / d[a])
                enter, leave = max(enter, middle - half), min(leave, middle + half)
        else:
            axes = 2 if kinds[p] == 2 else 3
            qa, qb, qc = 0.0, 0.0, -1.0
            for a in range(axes):
                qa += d[a] * d[a]
                qb += d[a] * o[a]
                qc += o[a] * o[a]
            root = qb * qb - qa * qc
            if root <= 0:
                continue
            enter, leave = (-qb - np.sqrt(root)) / qa, (-qb + np.sqrt(root)) / qa
            if kinds[p] == 2:
                middle, half = -o[2] / d[2], abs(1.0 / d[2])
                enter, leave = max(enter, middle - half), min(leave, middle + half)
        if enter < leave and leave > 0 and enter < limit:
            return True
    return False
