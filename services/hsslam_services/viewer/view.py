"""The drawing end of the recorder: run.rrd, run.1.rrd, ... and a live viewer; the recorder waits for none."""

import contextlib
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from hsslam_node.errors import UserError
from hsslam_proto import messages
from hsslam_proto.mesh.blocks_message import MeshBlocks
from hsslam_services.bus.publisher import Report
from hsslam_services.viewer.layout import blueprint
from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.scene import RerunScene

_FRAMES_WAITING = 2
_OTHERS_WAITING = 4096
_CHECK_S = 2.0
_FIRST_CHECK_S = 20.0  # a viewer may take its time to start
_STUCK_S = 3.0  # in the drawing of one message
_CLOSE_S = 10.0


@dataclass(frozen=True)
class _Intervals:
    """The least time between what is drawn of a kind; poses and blocks of the mesh are drawn together.

    `flush_s`: what is drawn of an entity leaves as a chunk this often. The end of a file lists all its
    chunks, so rerun keeps 2.4 kB of each in memory until then.
    """

    images_s: float
    meshes_s: float
    poses_s: float
    flush_s: float


_FILE = _Intervals(images_s=0.1, meshes_s=10.0, poses_s=1.0, flush_s=10.0)
_LIVE = _Intervals(images_s=0.0, meshes_s=0.3, poses_s=0.1, flush_s=0.2)


class RerunView:
    """Draws messages into `rrd` and into the viewer: "none", "spawn", "web" or "connect:URL".

    `memory_gb` is the limit of a viewer that is started here (None: 0.5 GB, a web server 0.15 GB).
    `write_to` goes on in another file: rerun keeps a list of all chunks of a file until its end.
    `show` never waits: frames push out older frames. A viewer that is closed or does not take data
    is told once through `tell`; the file goes on.

    Raises:
        UserError: the viewer cannot be started.
    """

    def __init__(
        self,
        rrd: Path,
        viewer: str,
        recording_id: str,
        report: Report,
        memory_gb: float | None = None,
    ) -> None:
        self._process: ViewerProcess | None = None
        live = None if viewer == "none" else self._open_viewer(viewer, report, memory_gb)
        self._rrd = rrd
        self._threads = [_Drawing(rr.FileSink(rrd), recording_id, _FILE, report)]
        if live is not None:
            watch = _Watch(viewer, report, self._process)
            self._threads.append(_Drawing(live, recording_id, _LIVE, report, watch))

    @property
    def dropped(self) -> int:
        """Messages that were pushed out before they were drawn."""
        return sum(thread.dropped for thread in self._threads)

    def write_to(self, rrd: Path) -> None:
        """Go on in this file, if it is not the one that is written; it opens alone."""
        if rrd != self._rrd:
            self._rrd = rrd
            self._threads[0].put(_NextFile(rrd))

    def show(self, message: messages.Message, in_file: bool = True, in_viewer: bool = True) -> None:
        """Queue one message for drawing; frames should have their colour as JPEG."""
        file, *live = self._threads
        for thread in [file] * in_file + live * in_viewer:
            thread.put(message)

    def show_images_every(self, seconds: float) -> None:
        """The least time between images in the live viewer, s; the file has its own."""
        for thread in self._threads[1:]:
            thread.images_s = seconds

    def close(self) -> None:
        """Draw what waits, write the end of the file; at most some seconds for a dead viewer."""
        for thread in self._threads:
            thread.stop()
        for thread in self._threads:
            thread.join(_CLOSE_S)
        if self._process is not None:
            self._process.close()

    def _open_viewer(self, viewer: str, report: Report, memory_gb: float | None) -> rr.GrpcSink:
        if viewer in ("spawn", "web"):
            process = ViewerProcess("spawn" if viewer == "spawn" else "web", memory_gb)
            if process.page is not None:
                report("info", f"viewer: open {process.page}")
            self._process = process
            return rr.GrpcSink(process.url)
        address = viewer.removeprefix("connect:")
        url = address if "://" in address else f"rerun+http://{address}/proxy"
        try:
            return rr.GrpcSink(url)
        except (RuntimeError, ValueError):
            raise UserError(
                f"--viewer {viewer}: expected connect:HOST:PORT or connect:rerun+http://HOST:PORT/proxy"
            ) from None


@dataclass(frozen=True)
class _NextFile:
    """Stands among the messages at which a new file begins."""

    rrd: Path


class _Watch:
    """Notices a live viewer that is gone, and tells of one that takes no data, as when it is frozen.

    While it takes none, the queue loses what is old, and what is new is drawn when it comes round.
    """

    def __init__(self, viewer: str, report: Report, process: ViewerProcess | None) -> None:
        self._viewer = viewer
        self._report = report
        self._process = process
        self._next_s = time.monotonic() + _CHECK_S
        self._patience_s = _FIRST_CHECK_S
        self._was_told = False

    def is_gone(self, stream: rr.RecordingStream) -> bool:
        """Checked now and then; tells it once."""
        if time.monotonic() < self._next_s:
            return False
        ended = self._process is not None and self._process.has_ended()
        if not ended:
            try:
                stream.flush(timeout_sec=self._patience_s)
                self._was_told = False
            except RuntimeError as error:
                ended = "timed out" not in str(error)
                if not ended:
                    self.takes_nothing()
        self._patience_s = _CHECK_S
        self._next_s = time.monotonic() + _CHECK_S
        if ended:
            self._report("warning", f"viewer {self._viewer} is closed; the run goes on without it")
        return ended

    def takes_nothing(self) -> None:
        """Tell it, once until it takes data again."""
        if not self._was_told:
            self._was_told = True
            self._report("warning", f"viewer {self._viewer} takes no data; the run goes on")


class _Drawing(threading.Thread):
    """One recording stream, its queue and the thread between them."""

    def __init__(
        self,
        sink: rr.FileSink | rr.GrpcSink,
        recording_id: str,
        intervals: _Intervals,
        report: Report,
        watch: _Watch | None = None,
    ) -> None:
        super().__init__(name="rerun", daemon=True)
        self.dropped = 0
        self._frames: deque[messages.Frame] = deque()
        self._others: deque[messages.Message | _NextFile] = deque()
        self._arrival = threading.Condition()
        self._stopped = False
        self._gone = False
        self._drawn_s = time.monotonic()
        self._report, self._watch = report, watch
        self.images_s = intervals.images_s
        self._image_ns = 0
        self._stream = rr.RecordingStream(
            "hsslam",
            recording_id=recording_id,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=intervals.flush_s),
        )
        self._stream.set_sinks(sink, default_blueprint=blueprint())
        self._scene = RerunScene(self._stream, intervals.poses_s, intervals.meshes_s)
        self.start()

    def put(self, message: messages.Message | _NextFile) -> None:
        if self._gone or not self._is_due(message):
            return
        if isinstance(message, MeshBlocks):
            self._scene.add_blocks(message)
            return
        is_frame = isinstance(message, messages.Frame)
        with self._arrival:
            if is_frame:
                self._frames.append(message)
                overflow = len(self._frames) > _FRAMES_WAITING and self._frames.popleft()
            else:
                self._others.append(message)
                overflow = len(self._others) > _OTHERS_WAITING and self._others.popleft()
            self.dropped += bool(overflow)
            self._arrival.notify()
        if overflow and self._watch is not None and time.monotonic() - self._drawn_s > _STUCK_S:
            self._watch.takes_nothing()  # the SDK waits for it

    def stop(self) -> None:
        with self._arrival:
            self._stopped = True
            self._arrival.notify()

    def run(self) -> None:
        while (message := self._next()) is not None:
            if isinstance(message, _NextFile):
                self._begin_file(message.rrd)
            else:
                self._scene.draw(message)
            self._drawn_s = time.monotonic()
            if self._watch is not None and self._watch.is_gone(self._stream):
                self._gone = True
                break
        with contextlib.suppress(RuntimeError):
            if not self._gone:
                self._scene.finish()
                self._stream.flush(timeout_sec=_CHECK_S)
        self._stream.disconnect()

    def _begin_file(self, rrd: Path) -> None:
        """Go on in this file, or in the one before, if this one cannot be written."""
        self._scene.end_file()
        try:
            self._stream.set_sinks(rr.FileSink(rrd), default_blueprint=blueprint())
        except RuntimeError as error:
            self._report("warning", f"{rrd}: {error}; the file before goes on")
            return
        self._scene.begin_file()

    def _next(self) -> messages.Message | _NextFile | None:
        with self._arrival:
            while not (self._others or self._frames):
                if self._stopped:
                    return None
                self._arrival.wait()
            return self._others.popleft() if self._others else self._frames.popleft()

    def _is_due(self, message: messages.Message | _NextFile) -> bool:
        """Thin out images, so that the file stays small."""
        if isinstance(message, messages.Frame):
            if 0 <= message.stamp_ns - self._image_ns < 1e9 * self.images_s:
                return False
            self._image_ns = message.stamp_ns
        return True
