"""The keyframes of a run as a path for ROS; apart from the process that publishes it."""

import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.store import KeyframeStore
from hsslam_services.ros2.stamp_clock import StampClock


def keyframe_path(
    store: KeyframeStore, robot: RobotFrames, clock: StampClock, now_ns: int, most: int
) -> tuple[list[int], np.ndarray]:
    """Stamps, and poses [n, 4, 4] of `base_link` in `map`, of at most `most` evenly chosen keyframes.

    Stamps are on the clock of ROS. Keyframes of a saved map come from another run, perhaps with another
    clock: their stamp is `now_ns`. A keyframe whose stamp the clock does not know yet is left out: the
    tracker stores a keyframe before it logs the pose of its frame.
    """
    source_ns = store.stamps_ns()
    ids = np.arange(0, len(source_ns), -(-len(source_ns) // most))
    ids = ids[(ids < store.inherited) | clock.is_known(source_ns[ids])]
    ros_ns = clock.ros_ns(source_ns[ids])
    stamps_ns = np.where(ids < store.inherited, now_ns, ros_ns)
    bases = [robot.base_pose(T) for T in store.poses_of(ids)]
    return stamps_ns.tolist(), np.array(bases).reshape(-1, 4, 4)
