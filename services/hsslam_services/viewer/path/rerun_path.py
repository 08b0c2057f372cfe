"""The path in the viewer, coloured by tracking quality, lost stretches in red."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain, count

import rerun as rr

from hsslam_proto.messages import Correction, Keyframe, Pose
from hsslam_proto.pose_codec import pose_matrix
from hsslam_services.viewer.path.fragment import FragmentPath
from hsslam_services.viewer.path.line import Color, PathLine, PathPose

_SEGMENT_POSES = 64  # per entity; a pose re-logs only its segment
_FINE_SEGMENTS = 64  # the newest; older segments are thinned and merged into long ones
_COARSE_STEP, _COARSE_POSES = 8, 512
_COARSE_SEGMENTS = 16  # the newest, which move with their keyframes: half an hour at 30 Hz
_MOST_STRETCHES, _MOST_FRAGMENTS = 64, 16  # the newest, which move, too
_LOST: Color = (255, 60, 60)


class RerunPath:
    """Draws poses as world/trajectory/<segment>, gaps of a lost camera as world/lost/<k>, and fragments that
    have joined the map as world/trajectory/fragment/<n>.

    It draws each of the newest poses, and one in eight older ones as world/trajectory/old/<n>. When keyframes
    are corrected, it moves and redraws the poses tracked from them, except the oldest.
    `is_drawn`: whether the drawing is up to date.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.is_drawn = True
        self._stream = stream
        self._segments, self._olds, self._stretches = count(), count(), count()
        self._is_lost = False
        self._fine: deque[PathLine] = deque()
        self._newest = self._segment()
        self._coarse = deque([self._old()], _COARSE_SEGMENTS)
        self._lost: deque[PathLine] = deque(maxlen=_MOST_STRETCHES)
        self._joined: deque[PathLine] = deque(maxlen=_MOST_FRAGMENTS)
        self._fragment = FragmentPath(0)  # the newest

    def add(self, pose: Pose) -> None:
        """Add a pose; a lost pose has no place in the map until its fragment joins the map."""
        if pose.status == "lost":
            if pose.fragment:
                self._of_fragment(pose.fragment).add(pose)
            if not self._is_lost and self._newest.poses:
                here = rr.Points3D(
                    [self._newest.poses[-1].t], colors=[_LOST], radii=rr.Radius.ui_points(7)
                )
                self._stream.log("world/lost/here", here)
            self._is_lost = True
            return
        at = PathPose.of(pose)
        if self._is_lost:
            self._end_stretch(at)
        self._newest.add(at)
        if len(self._newest.poses) > _SEGMENT_POSES:
            self._begin_segment(at)
        self.is_drawn = False

    def begin_with(self, lines: Iterable[list[PathPose]]) -> None:
        """Begin with the parts of an earlier path, which are thinned already."""
        for line in lines:
            for first in range(0, len(line) - 1, _COARSE_POSES):
                self._next_old(*line[first : first + _COARSE_POSES + 1])
        self._next_old()
        self.is_drawn = False

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Add a keyframe; one of a fragment gives the fragment its place in the map."""
        if keyframe.fragment:
            self._of_fragment(keyframe.fragment).add_keyframe(keyframe)
            self.is_drawn = False

    def correct(self, moved: Correction) -> None:
        """Move the poses tracked from these keyframes."""
        used = {pose.keyframe for line in self._lines() for pose in line.poses}
        used |= self._fragment.keyframes
        T_world_keyframe = {
            k: pose_matrix([*t, *q])
            for k, t, q in zip(moved.keyframes, moved.t, moved.q, strict=True)
            if k in used
        }
        self._fragment.correct(T_world_keyframe)
        for line in self._lines():
            line.correct(T_world_keyframe)
        self.is_drawn = False

    def draw(self) -> None:
        """Draw the changes."""
        if self._fragment.has_news:
            self._place_fragment()
        for line in self._lines():
            line.draw(self._stream)
        self.is_drawn = True

    def draw_again(self) -> None:
        """Draw all lines that may still move again, for a new file."""
        for line in self._lines():
            line.is_drawn = False
        self.draw()

    def _lines(self) -> Iterator[PathLine]:
        return chain(self._coarse, self._fine, [self._newest], self._lost, self._joined)

    def _segment(self) -> PathLine:
        return PathLine(f"world/trajectory/{next(self._segments)}")

    def _old(self) -> PathLine:
        return PathLine(f"world/trajectory/old/{next(self._olds)}")

    def _of_fragment(self, number: int) -> FragmentPath:
        if number != self._fragment.number:
            self._fragment = FragmentPath(number)
        return self._fragment

    def _place_fragment(self) -> None:
        """Place the newest fragment in the map; the lost gap before it ends at its first pose."""
        line = PathLine(
            f"world/trajectory/fragment/{self._fragment.number}", self._fragment.placed()
        )
        if self._joined and self._joined[-1].entity == line.entity:
            self._joined.pop()
        self._joined.append(line)
        if self._fragment.stretch is not None:
            self._fragment.stretch.poses.pop()
            self._fragment.stretch.add(line.poses[0]._replace(color=_LOST))

    def _end_stretch(self, at: PathPose) -> None:
        self._stream.log("world/lost/here", rr.Clear(recursive=False))
        if self._newest.poses:
            ends = [p._replace(color=_LOST) for p in (self._newest.poses[-1], at)]
            stretch = PathLine(f"world/lost/{next(self._stretches)}", ends, width=2.5)
            self._lost.append(stretch)
            self._fragment.end_stretch(stretch)
        self._is_lost = False
        self._begin_segment()

    def _begin_segment(self, *first: PathPose) -> None:
        self._fine.append(self._newest)
        self._newest = self._segment()
        self._newest.add(*first)
        self._newest.joins = bool(first)
        if len(self._fine) > _FINE_SEGMENTS:
            self._coarsen(self._fine.popleft())

    def _coarsen(self, segment: PathLine) -> None:
        """Move a segment, thinned, into a long segment."""
        self._stream.log(segment.entity, rr.Clear(recursive=False))
        if len(segment.poses) < 2:
            return
        if not segment.joins and self._coarse[-1].poses:  # the camera was lost between them
            self._next_old()
        self._coarse[-1].add(*segment.poses[::_COARSE_STEP])
        if len(self._coarse[-1].poses) >= _COARSE_POSES:
            self._next_old(self._coarse[-1].poses[-1])

    def _next_old(self, *first: PathPose) -> None:
        """Begin a long segment; if there are too many, the oldest stays as drawn."""
        self._coarse[0].draw(self._stream)
        self._coarse.append(self._old())
        self._coarse[-1].add(*first)
