"""Adam on the pose of one frame."""

import numpy as np

from hsslam_node.config import RenderingTrackerConfig
from hsslam_node.geometry.pose_adam import PoseAdam
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.tracking.pose_objective import PoseObjective


def descend(
    objective: PoseObjective, T_world_cam: np.ndarray, config: RenderingTrackerConfig
) -> np.ndarray:
    """The pose [4, 4] with the smallest loss of those visited, the start T_world_cam included."""
    adam = PoseAdam(config.adam_beta1)
    rates = np.array([config.translation_rate] * 3 + [config.rotation_rate] * 3)
    T, best, least = T_world_cam, T_world_cam, float("inf")
    for _ in range(config.iterations):
        loss, gradient = objective(T)
        if loss < least:
            best, least = T, loss
        T = moved_about_camera(T, adam.step(gradient, rates))
    return best
