"""A scene as the text files of COLMAP: cameras.txt, images.txt, points3D.txt.

Cameras have x right, y down, z forward, as here. The first pixel's centre is at (0.5, 0.5), here at (0, 0).
Poses map the world to the camera, quaternions are wxyz. Ids count from 1.
Source: https://colmap.github.io/format.html
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.se3_batch import inverse_batch, quaternions_from_rotations

_SAME_M = 0.03  # a point is seen if the depth of its pixel differs by less


class Observations(NamedTuple):
    """What one image sees of the points."""

    points: np.ndarray  # [m] int64, their indices
    uv: np.ndarray  # [m, 2] px, pixel centres at integers


def observe(
    points: np.ndarray, camera: Camera, T_world_cam: np.ndarray, depth_m: np.ndarray, most: int
) -> Observations:
    """The first `most` of points [N, 3] m, world, that lie on the surface that a camera measured.

    Args:
        points: ordered so that the first ones cover the scene.
        camera: of the depth.
        T_world_cam: [4, 4].
        depth_m: [H, W], planar, 0 = no measurement.
        most: number of points.
    """
    u, v, z = project(points, camera, inverse(T_world_cam))
    column, row = np.round(u).astype(np.int64), np.round(v).astype(np.int64)
    inside = (z > 0) & (column >= 0) & (column < camera.width_px)
    inside &= (row >= 0) & (row < camera.height_px)
    seen = np.flatnonzero(inside)
    measured_m = depth_m[row[seen], column[seen]]
    seen = seen[(measured_m > 0) & (np.abs(z[seen] - measured_m) < _SAME_M)][:most]
    return Observations(seen, np.stack([u[seen], v[seen]], axis=1))


def cameras_text(camera: Camera) -> str:
    """cameras.txt of one camera without a lens, with id 1."""
    size = f"{camera.width_px} {camera.height_px}"
    center = f"{camera.cx + 0.5!r} {camera.cy + 0.5!r}"
    head = "# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy\n"
    return f"{head}1 PINHOLE {size} {camera.fx!r} {camera.fy!r} {center}\n"


def images_text(
    T_world_cam: np.ndarray, names: Sequence[str], observations: Sequence[Observations]
) -> str:
    """images.txt of the images with these file names, poses [n, 4, 4] and observations."""
    T_cam_world = inverse_batch(T_world_cam)
    x, y, z, w = quaternions_from_rotations(T_cam_world[:, :3, :3]).T
    numbers = np.column_stack([w, x, y, z, T_cam_world[:, :3, 3]])
    lines = [
        "# IMAGE_ID qw qx qy qz tx ty tz CAMERA_ID NAME",
        "# (X Y POINT3D_ID) of each observation",
    ]
    for k, (name, row, seen) in enumerate(zip(names, numbers, observations, strict=True), 1):
        lines.append(f"{k} {' '.join(f'{number:.12g}' for number in row)} 1 {name}")
        pairs = zip((seen.uv + 0.5).tolist(), (seen.points + 1).tolist(), strict=True)
        lines.append(" ".join(f"{u:.3f} {v:.3f} {point}" for (u, v), point in pairs))
    return "\n".join(lines) + "\n"


def points_text(
    points: np.ndarray, colors: np.ndarray, observations: Iterable[Observations]
) -> str:
    """points3D.txt of points [N, 3] m, world, with colours [N, 3] uint8 RGB and observations.

    Their error is 0 px: the observations are where the points project to.
    """
    tracks: list[list[str]] = [[] for _ in points]
    for image, seen in enumerate(observations, 1):
        for index, point in enumerate(seen.points.tolist()):
            tracks[point].append(f" {image} {index}")
    rows = zip(points.tolist(), colors.tolist(), tracks, strict=True)
    lines = [
        f"{k} {x:.6f} {y:.6f} {z:.6f} {red} {green} {blue} 0{''.join(track)}"
        for k, ((x, y, z), (red, green, blue), track) in enumerate(rows, 1)
    ]
    return "\n".join(["# POINT3D_ID X Y Z R G B ERROR (IMAGE_ID POINT2D_IDX)...", *lines]) + "\n"
