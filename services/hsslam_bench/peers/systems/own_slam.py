"""HS-SLAM itself as a peer, alone in its process: preset `realtime` in lockstep."""

from collections.abc import Iterable

from hsslam_bench.peers.systems.peer import Estimate
from hsslam_node.device.device import CPU
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.warm_start import warm_start

_CONFIG = PRESETS["realtime"]


def prepare() -> None:
    """Load the compiled kernels."""
    warm_start(_CONFIG, CPU)


def track_and_map(frames: Iterable[Frame]) -> Estimate:
    """Final poses and mesh of the frames.

    Raises:
        UserError: the source has no readable frame.
    """
    slam = Slam(_CONFIG)
    for frame in frames:
        slam.process(frame)
    if slam.store is None or slam.parameters is None:
        raise UserError("no readable frame: expected at least one")
    slam.finish()
    return Estimate(slam.trajectory(), slam.mesh(_CONFIG.mesher.final_voxel_m))
