"""What Foxglove draws of a run, beside the run's own messages in the log: when which of it is written."""

import time
from collections.abc import Callable

from hsslam_proto.distance.messages import Grid
from hsslam_proto.foxglove.visualisation import (
    VizMessage,
    cleared_scene,
    viz_blocks,
    viz_messages,
)
from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.mesh.assembled import PendingBlocks
from hsslam_proto.mesh.messages import Mesh, MeshBlocks
from hsslam_proto.message import Message

_MESH_INTERVAL_S = 10.0
_GRID_INTERVAL_NS = 1_000_000_000
_BLOCKS_AT_ONCE = 128  # 20 ms; frames wait meanwhile


class FoxgloveLayer:
    """Poses, images and path at once; the grid once a second, each block of the mesh that changed every 10 s.

    `write(message, stamp_ns)` puts a message of the layer into the log.
    """

    def __init__(self, write: Callable[[VizMessage, int], None]) -> None:
        self._write = write
        self._blocks = PendingBlocks()
        self._mesh_s = float("-inf")
        self._next_grid_ns = 0
        self._epochs = EpochOrder()

    def add(self, message: Message, stamp_ns: int) -> None:
        """Write what a message of the run looks like, or keep it for later."""
        if self._epochs.begins_with(message):
            self._blocks.forget_before(self._epochs.now)
            self._write(cleared_scene(stamp_ns), stamp_ns)
        elif self._epochs.is_past(message):
            return
        if isinstance(message, MeshBlocks):
            self._blocks.add(message)
        if isinstance(message, Mesh):
            self._blocks.take()  # the mesh of the saver is in their place
        if isinstance(message, Grid):
            if stamp_ns < self._next_grid_ns:
                return
            self._next_grid_ns = stamp_ns + _GRID_INTERVAL_NS
        for viz in viz_messages(message, stamp_ns):
            self._write(viz, stamp_ns)

    def write_blocks(self, at_once: bool = False) -> None:
        """Write blocks that have changed, if it is time; `at_once`: all of them."""
        now_s = time.monotonic()
        if not at_once and now_s - self._mesh_s < _MESH_INTERVAL_S:
            return
        stamp_ns = time.time_ns()
        news = self._blocks.take(None if at_once else _BLOCKS_AT_ONCE)
        if not self._blocks:
            self._mesh_s = now_s
        if news.anew:
            self._write(cleared_scene(stamp_ns), stamp_ns)
        if news.blocks:
            self._write(viz_blocks(news.blocks, stamp_ns), stamp_ns)
