"""HS-SLAM itself, for the same table: preset `realtime` in one process, as lockstep runs it."""

from collections.abc import Iterable

import numpy as np

from hsslam_bench.peers.systems.peer import Estimate
from hsslam_node.device.device import CPU
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.warm_start import warm_start

_CONFIG = PRESETS["realtime"]


def prepare() -> None:
    """Load the machine code."""
    warm_start(_CONFIG, CPU)


def track_and_map(frames: Iterable[Frame]) -> Estimate:
    """Final poses and mesh of the frames.

    Raises:
        UserError: there is no frame.
    """
    slam = Slam(_CONFIG)
    found = [(frame.stamp_ns, slam.process(frame)) for frame in frames]
    if slam.store is None or slam.parameters is None:
        raise UserError("no frame could be read: expected some")
    slam.finish()
    T_world_keyframe = slam.store.poses()
    tracked = [(stamp, result) for stamp, result in found if result.status != "lost"]
    poses = [T_world_keyframe[result.keyframe] @ result.T_keyframe_cam for _, result in tracked]
    stamps_ns = np.array([stamp for stamp, _ in tracked], np.int64)
    mesh = slam.mesh(_CONFIG.mesher.final_voxel_m)
    return Estimate(Trajectory(stamps_ns, np.array(poses)), mesh)
