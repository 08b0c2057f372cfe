"""The robot's frames as ROS names them (REP 103, REP 105), from poses of its camera.

`world`, the frame of poses and map, has the axes of the first camera: x right, y down, z forward. `map` is
fixed to it and has the axes of a robot: x forward, y left, z up. If the camera of the robot that began the
world is at the origin of `world`, its `base_link` is at the origin of `map`. `odom` begins at the robot of
this run, with the height and tilt that it has in `map`, and has no jumps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.pose_covariance import carried, turned
from hsslam_node.geometry.se3 import inverse, se3_log, transform

# xyzw, base_link <- optical frame of a camera looking ahead
_TURN = np.array([-0.5, 0.5, -0.5, 0.5])
_UNIT = 1e-3  # largest error of a quaternion's norm


def _camera_ahead() -> np.ndarray:
    return transform(np.zeros(3), _TURN)


@dataclass(frozen=True)
class RobotFrames:
    """Where the camera is on the robot, `T_base_cam` [4, 4]: its optical frame (x right, y down, z forward)
    in `base_link` (x forward, y left, z up); by default in its origin, looking ahead.

    T_level_world: world to `map`, [4, 4], if another robot began the world; None: this one did.
    """

    T_base_cam: np.ndarray = field(default_factory=_camera_ahead)
    T_level_world: np.ndarray | None = None

    @classmethod
    def mounted(cls, numbers: Sequence[float]) -> "RobotFrames":
        """From x y z (m) and qx qy qz qw; none: the default.

        Raises:
            UserError: not 7 finite numbers, or no unit quaternion.
        """
        return cls(mounting("--base-T-camera", numbers)) if numbers else cls()

    @property
    def T_map_world(self) -> np.ndarray:
        """World to `map`, [4, 4]."""
        return self.T_base_cam if self.T_level_world is None else self.T_level_world

    def base_pose(self, T_world_cam: np.ndarray) -> np.ndarray:
        """`base_link` in `map` [4, 4]."""
        return self.T_map_world @ T_world_cam @ inverse(self.T_base_cam)

    def in_odom(self, T_odom_cam: np.ndarray) -> np.ndarray:
        """`base_link` in `odom` [4, 4]."""
        return self.T_base_cam @ T_odom_cam @ inverse(self.T_base_cam)

    def on_level(self, T_odom_cam: np.ndarray, T_world_cam: np.ndarray) -> np.ndarray:
        """T_odom_cam [4, 4] with the height and tilt that `base_link` has in `map`; its x, y and heading
        in `odom` stay."""
        T_cam_base = inverse(self.T_base_cam)
        T_odom_base = self.in_odom(T_odom_cam)
        T_map_base = self.base_pose(T_world_cam)
        T_odom_map = _on_floor(T_odom_base) @ inverse(_on_floor(T_map_base))
        return T_cam_base @ T_odom_map @ T_map_base @ self.T_base_cam

    def base_covariance(self, covariance: np.ndarray, T_world_cam: np.ndarray) -> np.ndarray:
        """[6, 6] of `base_pose`, about its own origin, axes of `map`.

        covariance: of `T_world_cam`, about the camera's centre, axes of `world`.
        """
        lever_m = T_world_cam[:3, :3] @ inverse(self.T_base_cam)[:3, 3]  # to base_link, in world
        return turned(carried(covariance, lever_m), self.T_map_world[:3, :3])


def _on_floor(T: np.ndarray) -> np.ndarray:
    """x, y and heading of a pose [4, 4], without its height and tilt."""
    cos, sin = T[:2, 0] / np.linalg.norm(T[:2, 0])
    out = np.eye(4)
    out[:2, :2], out[:2, 3] = [[cos, -sin], [sin, cos]], T[:2, 3]
    return out


def mounting(option: str, numbers: Sequence[float]) -> np.ndarray:
    """The transform [4, 4] that an option gives as x y z (m) and qx qy qz qw; none: the identity.

    Raises:
        UserError: not 7 finite numbers, or no unit quaternion.
    """
    if not numbers:
        return np.eye(4)
    text = " ".join(f"{number:g}" for number in numbers)
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        raise UserError(f"{option} {text}: expected 7 numbers: x y z qx qy qz qw")
    norm = float(np.linalg.norm(numbers[3:]))
    if abs(norm - 1) > _UNIT:
        raise UserError(
            f"{option} {text}: qx qy qz qw has norm {norm:.4g}: expected a unit quaternion"
        )
    return transform(np.array(numbers[:3]), np.array(numbers[3:]))


def level_frame(base_T_camera: Sequence[float], *, in_ros: bool) -> np.ndarray | None:
    """World to `map` of the robot, [4, 4], if the camera's place on the robot is given or ROS uses `map`;
    else None: the floor that the camera sees is level."""
    if not (base_T_camera or in_ros):
        return None
    return RobotFrames.mounted(base_T_camera).T_base_cam


def velocity(T_then: np.ndarray, T_now: np.ndarray, seconds: float) -> np.ndarray:
    """[6] m/s and rad/s between two poses [4, 4], in the moving axes."""
    return se3_log(inverse(T_then) @ T_now) / seconds
