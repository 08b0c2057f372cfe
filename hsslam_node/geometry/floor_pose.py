"""Poses on a floor, x, y and yaw, as RViz sends them, and the camera poses that belong to them."""

from dataclasses import dataclass, field

import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.view_distance import TURN_M_PER_RAD


@dataclass(frozen=True)
class FloorPose:
    """Position of a robot in a frame whose z is up, and its heading: 0 along x, positive to the left."""

    x_m: float
    y_m: float
    yaw_rad: float

    def distance_m(self, other: "FloorPose") -> float:
        """Distance of two positions."""
        return float(np.hypot(self.x_m - other.x_m, self.y_m - other.y_m))

    def turn_rad(self, other: "FloorPose") -> float:
        """The angle between two headings, 0 to pi."""
        turn = self.yaw_rad - other.yaw_rad
        return float(abs(np.arctan2(np.sin(turn), np.cos(turn))))


@dataclass(frozen=True)
class FloorFrames:
    """Converts poses on the floor to camera poses in the world, and back.

    T_floor_world: world to a frame whose z is up, [4, 4].
    T_base_cam: the camera on the robot, [4, 4], as of `RobotFrames`; by default the robot is the camera.
    """

    T_floor_world: np.ndarray
    T_base_cam: np.ndarray = field(default_factory=lambda: RobotFrames().T_base_cam)

    @property
    def up(self) -> np.ndarray:
        """The direction against gravity [3], world."""
        return self.T_floor_world[2, :3]

    def pose_of(self, T_world_cam: np.ndarray) -> FloorPose:
        """Where the robot stands if its camera is at T_world_cam [4, 4]."""
        T = self._placed(T_world_cam)
        return FloorPose(float(T[0, 3]), float(T[1, 3]), _yaw_rad(T[:3, :3]))

    def camera_at(self, at: FloorPose, known: np.ndarray) -> np.ndarray:
        """T_world_cam [4, 4] of a robot at this floor pose; height and tilt are those of the nearest
        `known` camera [n, 4, 4], by position and heading."""
        poses = [self.pose_of(T) for T in known]
        away = [at.distance_m(pose) + TURN_M_PER_RAD * at.turn_rad(pose) for pose in poses]
        nearest = int(np.argmin(away))
        turn = at.yaw_rad - poses[nearest].yaw_rad
        T = self._placed(known[nearest])
        c, s = np.cos(turn), np.sin(turn)
        T[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ T[:3, :3]
        T[:2, 3] = at.x_m, at.y_m
        return inverse(self.T_floor_world) @ T @ self.T_base_cam

    def _placed(self, T_world_cam: np.ndarray) -> np.ndarray:
        """The robot in the frame of the floor, [4, 4]."""
        return self.T_floor_world @ T_world_cam @ inverse(self.T_base_cam)


def _yaw_rad(R: np.ndarray) -> float:
    """Heading of a robot R [3, 3] (x ahead, z up); if it looks straight down or up, that of its upper or
    lower side."""
    ahead, up = R[:, 0], R[:, 2]
    level = ahead - ahead[2] * up
    return float(np.arctan2(level[1], level[0]))
