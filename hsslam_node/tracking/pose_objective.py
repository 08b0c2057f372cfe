"""What tracking by rendering minimises, whoever computes it."""

from typing import Protocol

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.tracking.map_view import MapView


class PoseObjective(Protocol):
    """A loss of the camera pose of one frame before one map."""

    def observe(self, frame: Frame, view: MapView) -> None:
        """Take this frame and this map."""
        ...

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        """The loss at T_world_cam [4, 4] and its gradient [6] (1/m, 1/rad) by a twist of the pose:
        translation in world axes, rotation in world axes about the camera's centre.

        The loss is infinite and the gradient zero where no pixel can be rendered.
        """
        ...
