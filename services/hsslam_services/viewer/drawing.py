"""A thread that draws messages into one recording stream of rerun."""

import math
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from hsslam_node.errors import on_one_line
from hsslam_proto import messages
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message
from hsslam_services.bus.publisher import Report
from hsslam_services.viewer.earlier_run import EarlierRun
from hsslam_services.viewer.layout import blueprint
from hsslam_services.viewer.scene import RerunScene
from hsslam_services.viewer.watch import ViewerWatch

_FRAMES_WAITING = 2
_OTHERS_WAITING = 4096
_STUCK_S = 3.0  # in the drawing of one message
_FLUSH_S = 2.0  # at the end, of a viewer
_FILE_FLUSH_S = 9.0  # of a file, after `stop`: the final mesh of an apartment takes 3 s of a core
_START_AFTER_END_S = 3.0  # a viewer that starts later than this after the end gets no data


@dataclass(frozen=True)
class Intervals:
    """Least time between two drawings of images, of mesh blocks and of poses.

    `flush_s`: interval of chunks. The end of a file lists all its chunks, so rerun keeps 2.4 kB of each in
    memory until then.
    `again_s`: interval of drawing camera, path, keyframes and loops again, as a server drops old data.
    """

    images_s: float
    meshes_s: float
    poses_s: float
    flush_s: float
    again_s: float = math.inf


@dataclass(frozen=True)
class NextFile:
    """A mark in the queue: a new file begins here."""

    rrd: Path


class Drawing(threading.Thread):
    """Draws a queue of messages into one recording stream.

    If there is a `watch`, the thread waits until the live viewer starts; a file opens at once. If the first
    file cannot be opened, as on a full disk, messages count as dropped until the next file, which lacks what
    they would have drawn; if a later file cannot be, the recording goes on in the file before. A message that
    cannot be drawn counts as dropped; `report` gets the first of them.
    """

    def __init__(
        self,
        sink: rr.FileSink | rr.GrpcSink,
        recording_id: str,
        intervals: Intervals,
        report: Report,
        watch: ViewerWatch | None = None,
    ) -> None:
        super().__init__(name="rerun", daemon=True)
        self.dropped = 0
        self._frames: deque[messages.Frame] = deque()
        self._others: deque[Message | NextFile | EarlierRun] = deque()
        self._arrival = threading.Condition()
        self._stopped_s = math.inf
        self._gone = False
        self._has_file = True  # or a viewer
        self._takes_messages = True  # else they have nowhere to go
        self._is_refusal_reported = False
        self._drawn_s = math.inf  # nothing drawn yet
        self._report, self._watch = report, watch
        self.images_s = intervals.images_s
        self._again_s = intervals.again_s
        self._image_ns = 0
        self._stream = rr.RecordingStream(
            "hsslam",
            recording_id=recording_id,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=intervals.flush_s),
        )
        self._sink = sink
        if watch is None:
            self._open_first()
        self._scene = RerunScene(self._stream, intervals.poses_s, intervals.meshes_s)
        self.start()

    def put(self, message: Message | NextFile | EarlierRun) -> None:
        if isinstance(message, NextFile):
            self._takes_messages = True
        elif not self._takes_messages:
            self.dropped += 1
            return
        if self._gone or not self._is_due(message):
            return
        if isinstance(message, MeshBlocks):
            self._scene.add_blocks(message)
            return
        is_frame = isinstance(message, messages.Frame)
        with self._arrival:
            if is_frame:
                self._frames.append(message)
                if overflow := len(self._frames) > _FRAMES_WAITING:
                    self._frames.popleft()
            else:
                self._others.append(message)
                if overflow := len(self._others) > _OTHERS_WAITING:
                    self._drop_oldest()
            self.dropped += overflow
            self._arrival.notify()
        if overflow and self._watch is not None and time.monotonic() - self._drawn_s > _STUCK_S:
            self._watch.takes_nothing()  # the SDK waits for it

    def stop(self) -> None:
        with self._arrival:
            self._stopped_s = time.monotonic()
            self._arrival.notify()

    def run(self) -> None:
        if self._watch is not None:
            if not self._watch.has_begun(self._has_waited_too_long):
                self._gone = True
                self._stream.disconnect()
                return
            self._begin()
        again_s = self._drawn_s + self._again_s
        while (message := self._next()) is not None:
            if isinstance(message, NextFile):
                self._begin_file(message.rrd)
            else:
                self._draw(message)
            self._drawn_s = time.monotonic()
            if self._drawn_s >= again_s:
                self._scene.draw_again()
                again_s = self._drawn_s + self._again_s
            if self._watch is not None and self._watch.is_gone(self._stream):
                self._gone = True
                break
        if not self._gone:
            self._finish()
        self._stream.disconnect()

    def _finish(self) -> None:
        """Draw the last poses and blocks, and wait until all data is in the file or with the viewer."""
        limit_s = _FLUSH_S
        try:
            self._scene.finish()
            if self._watch is None:
                limit_s = max(_FILE_FLUSH_S - (time.monotonic() - self._stopped_s), _FLUSH_S)
            self._stream.flush(timeout_sec=limit_s)
        except RuntimeError as error:
            if self._watch is None and self._has_file:
                why = on_one_line(str(error))
                self._report("warning", f"rerun: {why}: the recording lacks its last data")

    def _draw(self, message: Message | EarlierRun) -> None:
        try:
            if isinstance(message, EarlierRun):
                self._scene.begin_with(message)
            else:
                self._scene.draw(message)
        except Exception as error:  # of rerun or a decoder; the other messages are still drawn
            self.dropped += 1
            if not self._is_refusal_reported:
                self._is_refusal_reported = True
                kind, why = type(message).__name__, on_one_line(str(error))
                self._report("warning", f"rerun: a {kind} message is not drawn: {why}")

    def _has_waited_too_long(self) -> bool:
        """Whether the run ended some seconds ago: after a short run the viewer may still start."""
        return time.monotonic() - self._stopped_s > _START_AFTER_END_S

    def _drop_oldest(self) -> None:
        """Drop the oldest message, but no mark of a new file, and not the run so far."""
        kept = (NextFile, EarlierRun)
        del self._others[next(i for i, m in enumerate(self._others) if not isinstance(m, kept))]

    def _open_first(self) -> None:
        try:
            self._begin()
        except RuntimeError as error:
            self._has_file = self._takes_messages = False
            why = on_one_line(str(error))
            self._report("warning", f"rerun: {why}: no recording until the next part of the log")

    def _begin(self) -> None:
        self._drawn_s = time.monotonic()
        self._stream.set_sinks(self._sink, default_blueprint=blueprint())

    def _begin_file(self, rrd: Path) -> None:
        """Go on in this file; if it cannot be written, in the previous one."""
        self._scene.end_file()
        try:
            self._stream.set_sinks(rr.FileSink(rrd), default_blueprint=blueprint())
        except RuntimeError as error:
            self._takes_messages = self._has_file
            why = "; the recording goes on in the previous file" if self._has_file else ""
            self._report("warning", f"{rrd}: {error}{why}")
            return
        self._has_file = self._takes_messages = True
        self._scene.begin_file()

    def _next(self) -> Message | NextFile | EarlierRun | None:
        with self._arrival:
            while not (self._others or self._frames):
                if self._stopped_s < math.inf:
                    return None
                self._arrival.wait()
            return self._others.popleft() if self._others else self._frames.popleft()

    def _is_due(self, message: Message | NextFile | EarlierRun) -> bool:
        """Whether to draw a message: images are thinned out, so that the file stays small."""
        if isinstance(message, messages.Frame):
            if 0 <= message.stamp_ns - self._image_ns < 1e9 * self.images_s:
                return False
            self._image_ns = message.stamp_ns
        return True
