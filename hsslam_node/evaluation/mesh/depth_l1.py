"""Depth error of a mesh in views from places where no camera was."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import trimesh

from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.rendering.depth_render import render_depth


@dataclass(frozen=True)
class DepthL1:
    """Mean absolute depth difference; a pixel without reconstruction counts as its full depth."""

    mean_m: float  # over all pixels of all views; NaN without a view
    median_m: float  # of the views' means
    hole_ratio: float  # share of the pixels without reconstruction, 0 to 1
    views: int


def depth_l1(
    reconstruction: trimesh.Trimesh,
    virtual: Iterable[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    views: Views,
) -> DepthL1:
    """Error over `virtual` views (T_world_cam [4, 4], true depth [H, W] m) as `camera` sees them.

    A pixel counts only if the given `views` observed its true surface.
    """
    mesh = chunked_mesh(reconstruction.vertices, reconstruction.faces)
    means, total_m, holes, pixels = [], 0.0, 0, 0
    for T_world_cam, true_depth in virtual:
        counted = np.zeros(true_depth.shape, bool)
        points = world_points(true_depth, camera, T_world_cam)
        counted[true_depth > 0] = views.observed(points)
        if not counted.any():
            continue
        depth, _ = render_depth(mesh, camera, T_world_cam)
        error = np.abs(depth[counted] - true_depth[counted].astype(np.float64))
        means.append(float(error.mean()))
        total_m += float(error.sum())
        holes += int((depth[counted] == 0).sum())
        pixels += error.size
    if not means:
        return DepthL1(float("nan"), float("nan"), float("nan"), 0)
    return DepthL1(total_m / pixels, float(np.median(means)), holes / pixels, len(means))
