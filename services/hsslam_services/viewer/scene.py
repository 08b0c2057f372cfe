"""Draws each message into the entity tree of the viewer (rerun 0.41)."""

import time
from collections.abc import Iterable

import msgspec
import numpy as np
import rerun as rr

from hsslam_node.geometry.se3 import rotation_from_quaternion
from hsslam_proto import messages, run_messages
from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.assembled import PendingBlocks
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message, Quaternion, Vector
from hsslam_services.log.frame_compression import jpeg
from hsslam_services.viewer.earlier_run import EarlierRun
from hsslam_services.viewer.mesh import draw_blocks, draw_whole
from hsslam_services.viewer.poses import RerunPoses

_BLOCK_KEYFRAMES = 32  # per entity; a keyframe re-logs only its block
_MOST_KEYFRAME_BLOCKS = 64  # the newest; bounds work and memory
_MOST_LOOPS = 1000  # the newest
_BLOCKS_AT_ONCE = 256  # of the mesh: other messages wait meanwhile
_FRUSTUM_DEPTH_M = 0.06
_IMAGE_PLANE_M = 0.2
_Placed = tuple[Vector, Quaternion]
_KEYFRAMES, _LOOPS = (190, 140, 50), (110, 255, 120)
_OF_MAP = (
    "world/trajectory",
    "world/lost",
    "world/keyframes",
    "world/loops",
    "world/mesh",
    "model",
)
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class RerunScene:
    """Draws messages into one recording stream.

    world (static view coordinates), world/camera, world/camera/image, world/trajectory/<segment>,
    world/lost/<stretch>, world/keyframes/<block>, world/loops, world/mesh/live/<block>, world/mesh/final,
    model, plots/*, events. It draws poses together every `poses_every_s`, and changed blocks of the mesh
    every `blocks_every_s`. A reset of the map clears all but the camera, plots and events.
    """

    def __init__(
        self, stream: rr.RecordingStream, poses_every_s: float, blocks_every_s: float = 0.0
    ) -> None:
        self._stream = stream
        self._poses = RerunPoses(stream, poses_every_s)
        self._blocks = PendingBlocks()
        self._blocks_every_s, self._blocks_s = blocks_every_s, float("-inf")
        self._epochs = EpochOrder()
        self._loops: dict[tuple[int, int], None] = {}  # newest last
        self._keyframes: dict[int, dict[int, _Placed]] = {}  # by their block, oldest first
        self._frustum: np.ndarray | None = None
        self._intrinsics: tuple[float, ...] = ()
        self._time: tuple[int, int] | None = None
        self._cleared_until_ns = 0  # what an earlier recorder drew up to then; 0: nothing
        self._log_styles()

    def draw(self, message: Message) -> None:
        """Log one message at its own time; a message without a sensor stamp gets the newest stamp."""
        if self._epochs.begins_with(message):
            self._clear()
        elif self._epochs.is_past(message):
            return
        match message:
            case messages.Frame():
                self._set_time(message.index, message.stamp_ns)
                self._draw_frame(message)
            case messages.Pose():
                self._set_time(message.index, message.stamp_ns)
                self._poses.add(message)
                if 0 < self._cleared_until_ns < message.stamp_ns:  # earlier lines are cleared then
                    self._cleared_until_ns = 0
                    self._poses.draw()
                    self._poses.draw_again()
            case messages.Keyframe():
                t, q = self._placed(message.id) or (
                    message.t,
                    message.q,
                )  # by an earlier correction
                self._place_keyframes([(message.id, (t, q))])
                self._poses.add_keyframe(msgspec.structs.replace(message, t=t, q=q))
            case messages.Correction():
                moved = zip(message.t, message.q, strict=True)
                self._place_keyframes(zip(message.keyframes, moved, strict=True))
                self._poses.correct(message)
                self._loops.update(dict.fromkeys(message.loops))
                while len(self._loops) > _MOST_LOOPS:
                    del self._loops[next(iter(self._loops))]
                self._draw_loops()
            case messages.MapVersion():
                self._plot("loss", message.loss)
            case mesh_messages.Mesh():
                self._draw_mesh(message)
            case messages.View():
                self._draw_view(message)
            case run_messages.Health():
                self._plot(f"memory_mb/{message.process}", message.rss_bytes / 1e6)
            case run_messages.Event():
                text = f"{message.process}: {message.text}"
                self._stream.log("events", rr.TextLog(text, level=_LEVELS[message.level]))
        if self._poses.is_due():
            self._poses.draw()
            self._restore_time()
        if self._blocks and time.monotonic() - self._blocks_s >= self._blocks_every_s:
            self._draw_blocks(_BLOCKS_AT_ONCE)

    def begin_with(self, earlier: EarlierRun) -> None:
        """Draw keyframes and path of the run so far in place of those that an earlier recorder drew."""
        if earlier.map_epoch < self._epochs.now:
            return
        if self._epochs.begins(earlier.map_epoch):
            self._clear()
        self._set_time(earlier.index, earlier.stamp_ns)
        self._cleared_until_ns = earlier.stamp_ns
        for entity in ("world/trajectory", "world/lost", "world/keyframes"):
            self._stream.log(entity, rr.Clear(recursive=True))
        self._place_keyframes(earlier.keyframes)
        self._poses.begin_with(earlier.lines)

    def add_blocks(self, message: MeshBlocks) -> None:
        """Draw these blocks of the live mesh when they are due; another thread may call this."""
        self._blocks.add(message)

    def end_file(self) -> None:
        """Draw the waiting poses; waiting blocks go into the next file."""
        self._poses.draw()

    def begin_file(self) -> None:
        """Draw all that a new file needs to open alone, except the mesh: the mesher sends its blocks."""
        self._log_styles()
        self._intrinsics = ()
        self.draw_again()

    def draw_again(self) -> None:
        """Draw camera, path, keyframes and loops again, for viewers without earlier data."""
        self._restore_time()
        self._poses.draw_again()
        self._draw_keyframes(self._keyframes)
        self._draw_loops()

    def finish(self) -> None:
        """Draw the waiting poses and blocks."""
        self._poses.draw()
        self._draw_blocks()

    def _log_styles(self) -> None:
        self._stream.log("world", rr.ViewCoordinates.RDF, static=True)
        for name in ("latency_ms", "fps", "quality", "loss"):
            self._stream.log(f"plots/{name}", rr.SeriesLines(names=name), static=True)

    def _draw_blocks(self, most: int | None = None) -> None:
        news = self._blocks.take(most)
        if self._epochs.begins(news.map_epoch):  # blocks may overtake other messages
            self._clear()
        self._restore_time()
        draw_blocks(self._stream, news)
        if not self._blocks:
            self._blocks_s = time.monotonic()

    def _clear(self) -> None:
        """Clear the old map: its coordinates are not those of the new map."""
        self._poses.begin_path()
        self._restore_time()
        for entity in _OF_MAP:
            self._stream.log(entity, rr.Clear(recursive=True))
        self._loops.clear()
        self._keyframes.clear()
        self._blocks.forget_before(self._epochs.now)

    def _set_time(self, index: int, stamp_ns: int) -> None:
        """Set the time of the following log calls; without it, data is absent from the timeline."""
        if self._time is None or stamp_ns >= self._time[1]:
            self._time = (index, stamp_ns)
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", timestamp=np.datetime64(stamp_ns, "ns"))

    def _draw_frame(self, frame: messages.Frame) -> None:
        size = (frame.width_px, frame.height_px)
        intrinsics = (frame.fx, frame.fy, frame.cx, frame.cy, *size)
        if intrinsics != self._intrinsics:
            self._intrinsics = intrinsics
            pinhole = rr.Pinhole(
                focal_length=(frame.fx, frame.fy),
                principal_point=(frame.cx, frame.cy),
                resolution=size,
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=_IMAGE_PLANE_M,
            )
            self._stream.log("world/camera/image", pinhole, static=True)
        image = rr.EncodedImage(contents=jpeg(frame), media_type="image/jpeg")
        self._stream.log("world/camera/image", image)
        if self._frustum is None:
            self._frustum = _frustum(frame)
            self._draw_keyframes(self._keyframes)

    def _place_keyframes(self, placed: Iterable[tuple[int, _Placed]]) -> None:
        """Draw keyframes at their new poses; remove the oldest blocks if there are too many."""
        oldest, changed = min(self._keyframes, default=0), set()
        for k, place in placed:
            block = k // _BLOCK_KEYFRAMES
            if block >= oldest:
                self._keyframes.setdefault(block, {})[k] = place
                changed.add(block)
        while len(self._keyframes) > _MOST_KEYFRAME_BLOCKS:
            gone = min(self._keyframes)
            del self._keyframes[gone]
            changed.discard(gone)
            self._stream.log(f"world/keyframes/{gone}", rr.Clear(recursive=False))
        self._draw_keyframes(changed)

    def _draw_keyframes(self, blocks: Iterable[int]) -> None:
        if self._frustum is None:
            return
        self._restore_time()
        for block in sorted(blocks):
            strips = [
                self._frustum @ rotation_from_quaternion(np.array(q)).T + np.array(t)
                for t, q in self._keyframes[block].values()
            ]
            self._stream.log(
                f"world/keyframes/{block}",
                rr.LineStrips3D(strips, colors=[_KEYFRAMES], radii=rr.Radius.ui_points(0.5)),
            )

    def _draw_loops(self) -> None:
        """Draw a line between the two keyframes of each loop closure."""
        ends = ((self._position(a), self._position(b)) for a, b in self._loops)
        lines = [[a, b] for a, b in ends if a is not None and b is not None]
        if lines:
            self._restore_time()
            self._stream.log(
                "world/loops",
                rr.LineStrips3D(lines, colors=[_LOOPS], radii=rr.Radius.ui_points(1.2)),
            )

    def _placed(self, k: int) -> _Placed | None:
        return self._keyframes.get(k // _BLOCK_KEYFRAMES, {}).get(k)

    def _position(self, k: int) -> Vector | None:
        placed = self._placed(k)
        return placed[0] if placed else None

    def _draw_mesh(self, mesh: mesh_messages.Mesh) -> None:
        self._restore_time()
        self._blocks.take()  # the final mesh replaces them
        draw_whole(self._stream, mesh)

    def _draw_view(self, view: messages.View) -> None:
        self._restore_time()
        shape = (view.height_px, view.width_px, 3)
        self._stream.log("model", rr.Image(np.frombuffer(view.color, np.uint8).reshape(shape)))

    def _plot(self, name: str, value: float) -> None:
        self._restore_time()
        self._stream.log(f"plots/{name}", rr.Scalars([value]))

    def _restore_time(self) -> None:
        if self._time is not None:
            self._set_time(*self._time)


def _frustum(frame: messages.Frame) -> np.ndarray:
    """One line strip through apex and corners of the image, [10, 3] m, camera axes."""
    u = np.array([-0.5, frame.width_px - 0.5, frame.width_px - 0.5, -0.5])
    v = np.array([-0.5, -0.5, frame.height_px - 0.5, frame.height_px - 0.5])
    corners = np.column_stack([(u - frame.cx) / frame.fx, (v - frame.cy) / frame.fy, np.ones(4)])
    points = np.vstack([np.zeros(3), corners * _FRUSTUM_DEPTH_M])
    return points[[0, 1, 2, 0, 3, 4, 0, 1, 4]].astype(np.float32)
