"""Keeps frames until their poses come; alone, as several processes need both."""

from collections import OrderedDict

from hsslam_proto import topics
from hsslam_proto.messages import Frame, Pose
from hsslam_services.bus.bus import Bus

MOST_WAITING = (
    4  # most that wait: a pose is at most two frames late, unless the machine is too slow
)


class WaitingFrames:
    """Subscribes to frames and returns the frame of a pose; then drops older frames."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._frames = bus.subscribe(topics.FRAME, MOST_WAITING)
        self._waiting: OrderedDict[tuple[int, int], Frame] = OrderedDict()

    def of(self, pose: Pose) -> Frame | None:
        """The frame of a pose; None if it did not come, or newer frames pushed it out."""
        for frame in self._frames.drain():
            self._waiting[frame.index, frame.stamp_ns] = frame
        of_pose = pose.index, pose.stamp_ns
        if of_pose in self._waiting:
            while next(iter(self._waiting)) != of_pose:
                self._waiting.popitem(last=False)
        while len(self._waiting) > MOST_WAITING:
            self._waiting.popitem(last=False)
        return self._waiting.pop(of_pose, None)

    def close(self) -> None:
        """End the subscription."""
        self._bus.unsubscribe(self._frames)
