"""The keyframes of a run as the path that ROS hears; apart from the process, which knows when it is due."""

import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.store import KeyframeStore
from hsslam_services.ros2.stamp_clock import StampClock


def keyframe_path(
    store: KeyframeStore, robot: RobotFrames, clock: StampClock, now_ns: int, most: int
) -> tuple[list[int], np.ndarray]:
    """Stamps, and poses [n, 4, 4] of `base_link` in `map`, of keyframes that are thinned evenly to `most`.

    Stamps are on the clock of ROS. Those of a saved map were taken in another run, perhaps by another clock:
    they are `now_ns`.
    """
    poses = store.poses()
    ids = np.arange(0, len(poses), -(-len(poses) // most))
    ros_ns = clock.ros_ns(store.stamps_ns()[ids])
    stamps_ns = np.where(ids < store.inherited, now_ns, ros_ns)
    return stamps_ns.tolist(), np.stack([robot.base_pose(T) for T in poses[ids]])
