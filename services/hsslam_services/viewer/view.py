"""Draws messages into run.rrd, run.1.rrd, ... and a live viewer; never blocks the recorder."""

import contextlib
from pathlib import Path

import rerun as rr

from hsslam_node.durable_file import sync_file
from hsslam_node.errors import UserError, on_one_line
from hsslam_proto.message import Message
from hsslam_services.bus.publisher import Report
from hsslam_services.run.viewer_url import viewer_url
from hsslam_services.viewer.drawing import Drawing, Intervals, NextFile
from hsslam_services.viewer.earlier_run import EarlierRun
from hsslam_services.viewer.open_viewer import OpenViewer
from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.watch import ViewerWatch

_CLOSE_S = 10.0
_FILE = Intervals(images_s=0.1, meshes_s=10.0, poses_s=1.0, flush_s=10.0)
_LIVE = Intervals(images_s=0.0, meshes_s=0.3, poses_s=0.1, flush_s=0.2, again_s=30.0)


class RerunView:
    """Draws messages into `rrd` and into the viewer: "none", "spawn", "web" or "connect:URL".

    `memory_gb`: memory limit of the viewer, as of `ViewerProcess`. `write_to` switches to another file: rerun
    keeps a list of all chunks of a file until its end. `show` never waits: new frames replace waiting ones.
    A native viewer that an earlier recorder of the run has opened is used again.
    If a viewer cannot be started, closes or takes no data, `report` gets one warning, and the file goes on.
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
        self._open = OpenViewer(rrd.parent, recording_id)
        self._files = [rrd]
        self._threads = [Drawing(rr.FileSink(rrd), recording_id, _FILE, report)]
        if viewer == "none":
            return
        try:
            live = self._open_viewer(viewer, memory_gb)
        except UserError as error:  # the log matters more
            report("warning", f"{error}: the run goes on without a viewer")
            return
        watch = ViewerWatch(viewer, report, self._process)
        self._threads.append(Drawing(live, recording_id, _LIVE, report, watch))

    @property
    def dropped(self) -> int:
        """Number of messages dropped before they were drawn."""
        return sum(thread.dropped for thread in self._threads)

    def write_to(self, rrd: Path) -> None:
        """Switch to this file, unless it is the current one; each file opens alone."""
        if rrd != self._files[-1]:
            self._files.append(rrd)
            self._threads[0].put(NextFile(rrd))

    def show(self, message: Message, in_file: bool = True, in_viewer: bool = True) -> None:
        """Queue one message for drawing; frames should have their colour as JPEG."""
        file, *live = self._threads
        for thread in [file] * in_file + live * in_viewer:
            thread.put(message)

    def begin_with(self, earlier: EarlierRun) -> None:
        """Draw the run so far, before anything else."""
        for thread in self._threads:
            thread.put(earlier)

    def show_images_every(self, seconds: float) -> None:
        """Set the least time between images in the live viewer, s; the file has its own."""
        for thread in self._threads[1:]:
            thread.images_s = seconds

    def close(self) -> None:
        """Draw the waiting messages and bring the files to the disk; give up after some seconds, as on a full
        disk."""
        for thread in self._threads:
            thread.stop()
        for thread in self._threads:
            thread.join(_CLOSE_S)
        if any(thread.is_alive() for thread in self._threads):
            rr.unregister_shutdown()  # at exit the SDK would wait forever for data that it cannot write
        for file in self._files:
            with contextlib.suppress(OSError):  # a disk that is full, or a file that was removed
                sync_file(file)
        if self._process is not None:
            self._process.close()
        self._open.forget()

    def _open_viewer(self, viewer: str, memory_gb: float | None) -> rr.GrpcSink:
        if viewer == "spawn":
            if url := self._open.url():
                return rr.GrpcSink(url)
            self._process = ViewerProcess("spawn", memory_gb)
            self._open.note(self._process)
            return rr.GrpcSink(self._process.url)
        if viewer == "web":
            self._process = ViewerProcess("web", memory_gb)
            return rr.GrpcSink(self._process.url)
        try:
            return rr.GrpcSink(viewer_url(viewer))
        except (RuntimeError, ValueError) as error:
            raise UserError(f"--viewer {viewer}: {on_one_line(str(error))}") from None
