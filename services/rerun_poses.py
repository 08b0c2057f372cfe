"""What every pose brings to the viewer, drawn some poses at a time: plots, camera and path."""

import time
from collections.abc import Sequence

import numpy as np
import rerun as rr

from hsslam_node.proto.messages import Pose
from hsslam_node.services.rerun_path import RerunPath

_FPS_WEIGHT = 0.1  # of the newest interval in the running mean
_MOST_WAITING = 64


class RerunPoses:
    """Collects poses and draws plots/*, world/camera, world/trajectory and world/lost from them.

    A call of the SDK costs as much for one pose as for ten: `is_due` says when `every_s` has gone by.
    """

    def __init__(self, stream: rr.RecordingStream, every_s: float) -> None:
        self._stream = stream
        self._every_s = every_s
        self._drawn_s = time.monotonic()
        self._waiting: list[Pose] = []
        self._path = RerunPath(stream)
        self._tracked_ns = 0
        self._interval_s = 0.0

    def add(self, pose: Pose) -> None:
        """One more to draw."""
        self._waiting.append(pose)

    def is_due(self) -> bool:
        """Whether some wait, and have for long enough."""
        late = time.monotonic() - self._drawn_s >= self._every_s
        return bool(self._waiting) and (late or len(self._waiting) >= _MOST_WAITING)

    def draw(self) -> None:
        """Draw all that wait, each at its own time."""
        self._drawn_s = time.monotonic()
        poses, self._waiting = self._waiting, []
        self._plot("quality", poses, [pose.quality for pose in poses])
        self._plot("latency_ms", poses, [(pose.publish_ns - pose.stamp_ns) / 1e6 for pose in poses])
        tracked = [pose for pose in poses if pose.status != "lost"]
        rates = [(pose, fps) for pose in tracked if (fps := self._fps(pose)) > 0]
        self._plot("fps", [pose for pose, _ in rates], [fps for _, fps in rates])
        if tracked:
            self._stream.send_columns(
                "world/camera",
                _times(tracked),
                rr.Transform3D.columns(
                    translation=[pose.t for pose in tracked],
                    quaternion=[pose.q for pose in tracked],
                ),
            )
        for pose in poses:
            self._stream.set_time("frame", sequence=pose.index)
            self._stream.set_time("time", timestamp=np.datetime64(pose.stamp_ns, "ns"))
            self._path.add(pose)
        self._path.draw()

    def begin_path(self) -> None:
        """Draw what waits; the next pose has nothing to do with those before."""
        self.draw()
        self._path = RerunPath(self._stream)

    def _plot(self, name: str, poses: Sequence[Pose], values: Sequence[float]) -> None:
        if poses:
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(f"plots/{name}", _times(poses), columns)

    def _fps(self, pose: Pose) -> float:
        """Running mean up to this pose; 0 for the first."""
        if self._tracked_ns:
            interval_s = (pose.publish_ns - self._tracked_ns) / 1e9
            mean_s = self._interval_s or interval_s
            self._interval_s = mean_s + _FPS_WEIGHT * (interval_s - mean_s)
        self._tracked_ns = pose.publish_ns
        return 1 / self._interval_s if self._interval_s > 0 else 0.0


def _times(poses: Sequence[Pose]) -> list[rr.TimeColumn]:
    stamps_ns = np.array([pose.stamp_ns for pose in poses], "datetime64[ns]")
    return [
        rr.TimeColumn("frame", sequence=[pose.index for pose in poses]),
        rr.TimeColumn("time", timestamp=stamps_ns),
    ]
