"""Writes Foxglove messages beside the run's own messages in the log."""

import time
from collections.abc import Callable

from hsslam_proto.distance.messages import Grid
from hsslam_proto.foxglove.poses import DrawnPoses
from hsslam_proto.foxglove.visualisation import (
    VizMessage,
    cleared_scene,
    viz_blocks,
    viz_calibration,
    viz_messages,
)
from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.mesh.assembled import PendingBlocks
from hsslam_proto.mesh.messages import Mesh, MeshBlocks
from hsslam_proto.message import Message
from hsslam_proto.messages import Frame, Pose

_MESH_INTERVAL_S = 10.0
_INTERVAL_NS = 1_000_000_000  # of grids, and of calibrations that stay the same
_BLOCKS_AT_ONCE = 128  # 20 ms; frames wait meanwhile


class FoxgloveLayer:
    """Writes poses and images at once, grid and calibration once a second, changed blocks of the mesh every
    10 s. A calibration is written at once if it changes, and in each part of the log.

    `write(message, log_ns, stamp_ns)` writes a message of the layer to the log. `log_ns` is the time of
    arrival; for the mesh it is the time of writing, as Foxglove removes entities that are older than a
    deletion. `stamp_ns` is the stamp of the sensor, on any clock. `poses` draws the poses.
    """

    def __init__(self, write: Callable[[VizMessage, int, int], None], poses: DrawnPoses) -> None:
        self._write = write
        self._poses = poses
        self._blocks = PendingBlocks()
        self._mesh_s = float("-inf")
        self._grid_ns = 0
        self._calibration: tuple[float, ...] = ()
        self._calibration_ns = 0
        self._epochs = EpochOrder()

    def add(self, message: Message, arrival_ns: int) -> None:
        """Write the Foxglove messages of a message, or keep its blocks for later."""
        if self._epochs.begins_with(message):
            self._blocks.forget_before(self._epochs.now)
            self._clear()
        elif self._epochs.is_past(message):
            return
        if isinstance(message, MeshBlocks):
            self._blocks.add(message)
        if isinstance(message, Mesh):
            self._blocks.take()  # the final mesh replaces them
            arrival_ns = time.time_ns()
        if isinstance(message, Grid):
            if _is_recent(self._grid_ns, arrival_ns):
                return
            self._grid_ns = arrival_ns
        if isinstance(message, Frame) and self._is_calibration_due(message, arrival_ns):
            self._write(viz_calibration(message), arrival_ns, message.stamp_ns)
        stamp_ns = getattr(message, "stamp_ns", arrival_ns)
        is_pose = isinstance(message, Pose)
        for viz in self._poses.of(message) if is_pose else viz_messages(message, arrival_ns):
            self._write(viz, arrival_ns, stamp_ns)

    def begin_part(self) -> None:
        """Write the calibration again with the next image: the next part of the log opens alone."""
        self._calibration = ()

    def write_blocks(self, at_once: bool = False) -> None:
        """Write changed blocks if 10 s have passed; `at_once`: write all now."""
        now_s = time.monotonic()
        if not at_once and now_s - self._mesh_s < _MESH_INTERVAL_S:
            return
        news = self._blocks.take(None if at_once else _BLOCKS_AT_ONCE)
        if not self._blocks:
            self._mesh_s = now_s
        if news.anew:
            self._clear()
        if news.blocks:
            now_ns = time.time_ns()
            self._write(viz_blocks(news.blocks, now_ns), now_ns, now_ns)

    def _is_calibration_due(self, frame: Frame, arrival_ns: int) -> bool:
        now = (frame.fx, frame.fy, frame.cx, frame.cy, frame.width_px, frame.height_px)
        if now == self._calibration and _is_recent(self._calibration_ns, arrival_ns):
            return False
        self._calibration, self._calibration_ns = now, arrival_ns
        return True

    def _clear(self) -> None:
        now_ns = time.time_ns()
        self._write(cleared_scene(now_ns), now_ns, now_ns)


def _is_recent(written_ns: int, arrival_ns: int) -> bool:
    """Whether something was written less than a second ago; not if the clock has been set back."""
    return 0 <= arrival_ns - written_ns < _INTERVAL_NS
