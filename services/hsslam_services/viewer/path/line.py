"""A line through poses in the viewer; each pose moves with its keyframe."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr

from hsslam_proto.message import Vector
from hsslam_proto.messages import Pose

Color = tuple[int, int, int]

_QUALITIES: tuple[tuple[float, Color], ...] = (  # colours between them are mixed
    (0.3, (255, 110, 40)),
    (0.6, (255, 220, 60)),
    (0.9, (70, 200, 255)),
)
_VISIBLE_M = 5e-3  # a line that moves by less is not drawn again


class PathPose(NamedTuple):
    """A pose on a line."""

    t: Vector  # m, world
    color: Color
    keyframe: int  # the pose moves with it; -1: none
    t_in_keyframe: Vector

    @classmethod
    def of(cls, pose: Pose) -> "PathPose":
        """The pose as published; it does not move if the message lacks `in_keyframe`, as in old logs."""
        keyframe = pose.keyframe if pose.in_keyframe else -1
        x, y, z = pose.in_keyframe[:3] if pose.in_keyframe else (0.0, 0.0, 0.0)
        return cls(pose.t, quality_color(pose.quality), keyframe, (x, y, z))


@dataclass
class PathLine:
    """A piece of the path, drawn as one entity."""

    entity: str
    poses: list[PathPose] = field(default_factory=list)
    width: float = 1.8  # points of the screen
    joins: bool = False  # begins at the end of the line before
    is_drawn: bool = False  # the drawing is up to date

    def add(self, *poses: PathPose) -> None:
        """Append these poses."""
        self.poses += poses
        self.is_drawn = False

    def draw(self, stream: rr.RecordingStream) -> None:
        """Draw the line if it has changed."""
        if len(self.poses) > 1 and not self.is_drawn:
            points, colors = [p.t for p in self.poses], [p.color for p in self.poses]
            strips, strip_colors = colored_strips(points, colors)
            radii = rr.Radius.ui_points(self.width)
            line = rr.LineStrips3D(strips, colors=_packed(strip_colors), radii=radii)
            stream.log(self.entity, line)
        self.is_drawn = True

    def correct(self, T_world_keyframe: Mapping[int, np.ndarray]) -> None:
        """Move the poses with their keyframes to the new poses [4, 4] of these."""
        moved = [i for i, pose in enumerate(self.poses) if pose.keyframe in T_world_keyframe]
        if not moved:
            return
        poses = [self.poses[i] for i in moved]
        T = np.stack([T_world_keyframe[pose.keyframe] for pose in poses])
        inside = np.array([pose.t_in_keyframe for pose in poses])
        now = np.einsum("nij,nj->ni", T[:, :3, :3], inside) + T[:, :3, 3]
        if np.abs(now - [pose.t for pose in poses]).max() < _VISIBLE_M:
            return
        for i, (x, y, z) in zip(moved, now.tolist(), strict=True):
            self.poses[i] = self.poses[i]._replace(t=(x, y, z))
        self.is_drawn = False


def colored_strips(
    points: list[Vector], colors: list[Color]
) -> tuple[list[list[Vector]], list[Color]]:
    """Split the line through the points into one strip for each run of equal colours."""
    strips, strip_colors, end = [], [], 0
    for color, run in groupby(colors[1:]):
        begin, end = end, end + sum(1 for _ in run)
        strips.append(points[begin : end + 1])
        strip_colors.append(color)
    return strips, strip_colors


def quality_color(quality: float) -> Color:
    """Orange (few points agree with the map) over yellow to blue (nearly all points agree)."""
    for (low, below), (high, above) in pairwise(_QUALITIES):
        if quality < high:
            share = max(quality - low, 0.0) / (high - low)
            r, g, b = (round(x + share * (y - x)) for x, y in zip(below, above, strict=True))
            return r, g, b
    return _QUALITIES[-1][1]


def _packed(colors: list[Color]) -> np.ndarray:
    """RGBA in one word each, [n] uint32: the SDK takes a third of the time that it takes for tuples."""
    return np.array([r << 24 | g << 16 | b << 8 | 0xFF for r, g, b in colors], np.uint32)
