"""Export a saved map for Gaussian splats, and draw their initial points beside an image.

    python examples/export_for_splats.py runs/desk [FOLDER]

FOLDER (default `splats`) is what nerfstudio and Brush open: `ns-train splatfacto --data FOLDER`. Training
needs no structure from motion: poses, points and depth come from the map. FOLDER/start.png shows the first
image on the left, and the points from its camera on the right.
"""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from hsslam_services.commands.maps.command import main as hsslam_map

_BACK = np.diag([1.0, -1.0, -1.0, 1.0])  # from the axes of OpenGL to those of OpenCV


def main(run: str, folder: str = "splats") -> int:
    """Export, then read the files as a trainer does."""
    if code := hsslam_map(["export", run, "--format", "nerfstudio", "--out", folder]):
        return code
    place = Path(folder)
    scene = json.loads((place / "transforms.json").read_text())
    first = scene["frames"][0]
    image = cv2.imread(str(place / first["file_path"]))
    assert image is not None
    drawn = draw(trimesh.load(place / scene["ply_file_path"]), first)
    cv2.imwrite(str(place / "start.png"), np.hstack([image, drawn]))
    is_drawn = drawn.any(axis=2)
    difference = np.abs(image.astype(int) - drawn)[is_drawn].mean()
    print(f"{len(scene['frames'])} images for ns-train splatfacto --data {folder}")
    print(f"points cover {is_drawn.mean():.0%} of the first image, {difference:.0f} of 255 off")
    return 0


def draw(cloud: Any, frame: dict[str, Any]) -> np.ndarray:
    """The points in the camera of the frame, [h, w, 3] uint8 BGR, each three pixels wide."""
    T_cam_world = np.linalg.inv(np.array(frame["transform_matrix"]) @ _BACK)
    x, y, z = T_cam_world[:3, :3] @ cloud.vertices.T + T_cam_world[:3, 3:]  # [N] each
    ahead = np.flatnonzero(z > 0.1)
    ahead = ahead[np.argsort(-z[ahead])]  # the nearest is drawn last
    u = (frame["fl_x"] * x[ahead] / z[ahead] + frame["cx"]).astype(int)
    v = (frame["fl_y"] * y[ahead] / z[ahead] + frame["cy"]).astype(int)
    image = np.zeros((frame["h"], frame["w"], 3), np.uint8)
    bgr = np.asarray(cloud.visual.vertex_colors)[ahead, 2::-1]
    inside = (u > 0) & (v > 0) & (u < frame["w"] - 1) & (v < frame["h"] - 1)
    for right, down in ((-1, 0), (1, 0), (0, -1), (0, 1), (0, 0)):
        image[v[inside] + down, u[inside] + right] = bgr[inside]
    return image


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
