"""Counts the frames that the service left out because it was behind; apart from `DroppedFrames`: of all."""

from pathlib import Path

from hsslam_proto.messages import Frame
from hsslam_services.bus.subscription import Subscription
from hsslam_services.run.camera_progress import CameraProgress


class LeftOutFrames:
    """The frames that did not get a pose because camera process or tracker were too slow.

    If the camera is a program outside, the network or that program may leave frames out as well. So frames
    count only if they arrived; gaps between the indices of frames never count. Frames that a recording leaves
    out because its disk is too slow do not count either.

    Args:
        frames: of the tracker.
        camera_arena: folder of the progress of the run's camera process; None: the run has none.
    """

    def __init__(self, frames: Subscription[Frame], camera_arena: Path | None) -> None:
        self._frames = frames
        self._camera_arena = camera_arena
        self._counted = self._count()

    def since_last(self) -> int:
        """Their number since the last call."""
        before, self._counted = self._counted, self._count()
        return max(self._counted - before, 0)  # a frame that comes late closes no gap

    def _count(self) -> int:
        if self._camera_arena is None:
            return self._frames.dropped - self._frames.missing
        progress = CameraProgress.read(self._camera_arena)
        return self._frames.dropped + progress.skipped - progress.skipped_by_wait
