"""Draws poses in the viewer: plots, the camera, and its path."""

import time
from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr

from hsslam_proto.messages import Correction, Keyframe, Pose
from hsslam_services.viewer.path.line import PathPose
from hsslam_services.viewer.path.rerun_path import RerunPath

_FPS_WEIGHT = 0.1  # of the newest interval in the running mean
_MOST_WAITING = 64


class RerunPoses:
    """Collects poses and draws plots/*, world/camera, world/trajectory and world/lost from them.

    A call of the SDK costs as much for one pose as for ten, so poses are drawn together every `every_s`.
    """

    def __init__(self, stream: rr.RecordingStream, every_s: float) -> None:
        self._stream = stream
        self._every_s = every_s
        self._drawn_s = time.monotonic()
        self._waiting: list[Pose] = []
        self._path = RerunPath(stream)
        self._camera: Pose | None = None  # the last one
        self._tracked_ns = 0
        self._interval_s = 0.0

    def add(self, pose: Pose) -> None:
        """Add a pose to draw."""
        self._waiting.append(pose)

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """The map has a new keyframe."""
        self._path.add_keyframe(keyframe)

    def begin_with(self, lines: Iterable[list[PathPose]]) -> None:
        """The path begins with the parts of an earlier one."""
        self._path.begin_with(lines)

    def correct(self, moved: Correction) -> None:
        """Move the poses tracked from corrected keyframes."""
        self._take_in()
        self._path.correct(moved)

    def is_due(self) -> bool:
        """Whether poses wait and `every_s` has passed, or too many wait."""
        late = time.monotonic() - self._drawn_s >= self._every_s
        some_wait = bool(self._waiting) or not self._path.is_drawn
        return (some_wait and late) or len(self._waiting) >= _MOST_WAITING

    def draw(self) -> None:
        """Draw all waiting poses, each at its own time."""
        self._drawn_s = time.monotonic()
        self._take_in()
        self._path.draw()

    def draw_again(self) -> None:
        """Draw the camera at its last pose and the path again, for a new file."""
        if self._camera is not None:
            at = self._camera
            place = rr.Transform3D(translation=at.t, quaternion=rr.Quaternion(xyzw=at.q))
            self._stream.log("world/camera", place)
        self._path.draw_again()

    def begin_path(self) -> None:
        """Draw the waiting poses, and begin a new path."""
        self.draw()
        self._path = RerunPath(self._stream)

    def _take_in(self) -> None:
        """Draw plots and camera of the waiting poses, and add them to the path."""
        poses, self._waiting = self._waiting, []
        self._plot("quality", poses, [pose.quality for pose in poses])
        self._plot("latency_ms", poses, [(pose.publish_ns - pose.stamp_ns) / 1e6 for pose in poses])
        tracked = [pose for pose in poses if pose.status != "lost"]
        rates = [(pose, fps) for pose in tracked if (fps := self._fps(pose)) > 0]
        self._plot("fps", [pose for pose, _ in rates], [fps for _, fps in rates])
        if tracked:
            self._camera = tracked[-1]
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

    def _plot(self, name: str, poses: Sequence[Pose], values: Sequence[float]) -> None:
        if poses:
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(f"plots/{name}", _times(poses), columns)

    def _fps(self, pose: Pose) -> float:
        """Running mean of the frame rate up to this pose; 0 for the first."""
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
