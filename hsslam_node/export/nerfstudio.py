"""Posed images as transforms.json, the input of nerfstudio, Brush and others."""

import json
from collections.abc import Sequence

import numpy as np

from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.geometry.camera import Camera

_MM_PER_M = 1000.0


def transforms_json(
    camera: Camera, T_world_cam: np.ndarray, names: Sequence[str], points_file: str
) -> str:
    """The text of transforms.json for images of one camera without a lens, with poses [n, 4, 4].

    Image k is images/NAME.jpg, its depth depth/NAME.png. Poses are camera to world, with OpenGL's camera
    axes, in the world of the points in `points_file`. The first pixel's centre is at (0.5, 0.5), so cx
    and cy are half a pixel more than those of `camera`.
    Source: https://docs.nerf.studio/quickstart/data_conventions.html
    """
    intrinsics = {
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx + 0.5,
        "cy": camera.cy + 0.5,
    }
    frames = [
        {
            "file_path": f"images/{name}.jpg",
            "depth_file_path": f"depth/{name}.png",
            **intrinsics,
            "transform_matrix": T.tolist(),
        }
        for name, T in zip(names, T_world_cam @ OPENGL_FROM_OPENCV, strict=True)
    ]
    whole = {"camera_model": "OPENCV", "ply_file_path": points_file, "frames": frames}
    return json.dumps(whole, indent=1) + "\n"


def depth_mm(depth_m: np.ndarray) -> np.ndarray:
    """Planar depth [H, W] m as nerfstudio reads it: [H, W] uint16 mm, 0: none, or beyond 65 m."""
    millimetres = np.round(depth_m * _MM_PER_M)
    return np.where(millimetres <= np.iinfo(np.uint16).max, millimetres, 0).astype(np.uint16)
