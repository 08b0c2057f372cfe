"""Poses in the viewer: plots, camera, and the path coloured by tracking quality, lost stretches in red."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
import rerun as rr

from hsslam_proto.message import Vector
from hsslam_proto.messages import Pose

Color = tuple[int, int, int]

_SEGMENT_POSES = 64  # per entity; a pose re-logs its segment only
_LOST: Color = (255, 60, 60)
_QUALITIES: tuple[tuple[float, Color], ...] = (  # colours between them are mixed
    (0.3, (255, 110, 40)),
    (0.6, (255, 220, 60)),
    (0.9, (70, 200, 255)),
)
_FPS_WEIGHT = 0.1  # of the newest interval in the running mean
_MOST_WAITING = 64
_FINE_SEGMENTS = 64  # the newest; of older ones every n-th pose is drawn, in long segments
_COARSE_STEP, _COARSE_POSES = 8, 512


class RerunPath:
    """Draws poses as world/trajectory/<segment>, what lies between a loss and its end as world/lost/<k>.

    Only the newest poses are drawn each; older ones as world/trajectory/old/<n>, one of eight.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._points: list[Vector] = []
        self._colors: list[Color] = []
        self._segment = 0
        self._stretches = 0
        self._is_lost = False
        self._is_drawn = True
        self._fine: deque[_Segment] = deque()
        self._coarse = _Segment(0, [], [])
        self._joins = False

    def add(self, pose: Pose) -> None:
        """Add a pose; a lost one is not drawn, as its position is a guess."""
        if pose.status == "lost":
            if not self._is_lost and self._points:
                self._stream.log(
                    "world/lost/here",
                    rr.Points3D(self._points[-1:], colors=[_LOST], radii=rr.Radius.ui_points(7)),
                )
            self._is_lost = True
            return
        if self._is_lost:
            self._end_stretch(pose.t)
        self._points.append(pose.t)
        self._colors.append(quality_color(pose.quality))
        self._is_drawn = False
        if len(self._points) > _SEGMENT_POSES:
            self._begin_segment(self._points[-1])

    def draw(self) -> None:
        """Draw the newest segment, if poses were added to it."""
        if len(self._points) > 1 and not self._is_drawn:
            self._draw_line(f"world/trajectory/{self._segment}", self._points, self._colors)
        self._is_drawn = True

    def draw_again(self) -> None:
        """Draw the newest poses once more, for a file that begins here."""
        long = self._coarse
        if len(long.points) > 1:
            self._draw_line(f"world/trajectory/old/{long.number}", long.points, long.colors)
        for segment in self._fine:
            if len(segment.points) > 1:
                self._draw_line(
                    f"world/trajectory/{segment.number}", segment.points, segment.colors
                )
        self._is_drawn = False
        self.draw()

    def _draw_line(self, entity: str, points: list[Vector], colors: list[Color]) -> None:
        strips, strip_colors = colored_strips(points, colors)
        line = rr.LineStrips3D(strips, colors=_packed(strip_colors), radii=rr.Radius.ui_points(1.8))
        self._stream.log(entity, line)

    def _end_stretch(self, t: Vector) -> None:
        self._stream.log("world/lost/here", rr.Clear(recursive=False))
        if self._points:
            line = rr.LineStrips3D(
                [[self._points[-1], t]], colors=[_LOST], radii=rr.Radius.ui_points(2.5)
            )
            self._stream.log(f"world/lost/{self._stretches}", line)
            self._stretches += 1
        self._is_lost = False
        self._begin_segment()

    def _begin_segment(self, *first: Vector) -> None:
        self.draw()
        self._fine.append(_Segment(self._segment, self._points, self._colors, self._joins))
        self._joins = bool(first)
        if len(self._fine) > _FINE_SEGMENTS:
            self._coarsen(self._fine.popleft())
        self._points = list(first)
        self._colors = self._colors[-1:] if first else []
        self._segment += 1

    def _coarsen(self, segment: "_Segment") -> None:
        """Let a segment go on as a part of a long one with fewer points."""
        self._stream.log(f"world/trajectory/{segment.number}", rr.Clear(recursive=False))
        if len(segment.points) < 2:
            return
        long = self._coarse
        if not segment.joins and long.points:  # the camera was lost between them
            long = self._coarse = _Segment(long.number + 1, [], [])
        long.points += segment.points[::_COARSE_STEP]
        long.colors += segment.colors[::_COARSE_STEP]
        self._draw_line(f"world/trajectory/old/{long.number}", long.points, long.colors)
        if len(long.points) >= _COARSE_POSES:
            self._coarse = _Segment(long.number + 1, long.points[-1:], long.colors[-1:])


@dataclass
class _Segment:
    """A piece of the path."""

    number: int
    points: list[Vector]
    colors: list[Color]
    joins: bool = False  # goes on where the one before ends


def colored_strips(
    points: list[Vector], colors: list[Color]
) -> tuple[list[list[Vector]], list[Color]]:
    """Lines through the points and their colours: one for each run of poses of equal colour."""
    strips, strip_colors, end = [], [], 0
    for color, run in groupby(colors[1:]):
        begin, end = end, end + sum(1 for _ in run)
        strips.append(points[begin : end + 1])
        strip_colors.append(color)
    return strips, strip_colors


def _packed(colors: list[Color]) -> np.ndarray:
    """RGBA in one word each, [n] uint32: a third of what the SDK takes for tuples."""
    return np.array([r << 24 | g << 16 | b << 8 | 0xFF for r, g, b in colors], np.uint32)


def quality_color(quality: float) -> Color:
    """From orange (few points agree with the map) over yellow to blue (nearly all do)."""
    for (low, below), (high, above) in pairwise(_QUALITIES):
        if quality < high:
            share = max(quality - low, 0.0) / (high - low)
            r, g, b = (round(x + share * (y - x)) for x, y in zip(below, above, strict=True))
            return r, g, b
    return _QUALITIES[-1][1]


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
        self._camera: Pose | None = None  # where it was last
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
        self._path.draw()

    def draw_again(self) -> None:
        """Place the camera where it was last, and as `RerunPath.draw_again`."""
        if self._camera is not None:
            at = self._camera
            place = rr.Transform3D(translation=at.t, quaternion=rr.Quaternion(xyzw=at.q))
            self._stream.log("world/camera", place)
        self._path.draw_again()

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
