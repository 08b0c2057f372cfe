"""Writes a log for the rerun viewer; separate from `export`, which then imports rerun only for this."""

import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import rerun as rr

from hsslam_node.durable_file import durable_file
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.topics import TOPICS
from hsslam_services.commands.log.progress import log_progress
from hsslam_services.commands.output_files import as_utf8
from hsslam_services.log.reading.reader import bus_messages, log_span_ns
from hsslam_services.log.reading.source import run_metadata
from hsslam_services.viewer.layout import blueprint
from hsslam_services.viewer.scene import RerunScene


def export_rrd(files: list[Path], path: Path) -> Iterator[str]:
    """Draw every message that the viewer shows, without thinning; yields a line for the file.

    Raises:
        OSError: the file cannot be written; then an older one stays.
    """
    with durable_file(path) as partial:
        _draw(files, partial)
    yield f"{path}: {path.stat().st_size / 1e6:.1f} MB"


def _draw(files: list[Path], path: Path) -> None:
    stream = rr.RecordingStream("hsslam", recording_id=_recording_id(files))
    stream.send_recording_name(as_utf8(_recording_name(files)))
    written = _Written(path)
    stream.set_sinks(rr.FileSink(written.pipe), default_blueprint=blueprint())
    written.start()
    try:
        _draw_messages(files, RerunScene(stream, poses_every_s=1.0), written)
    finally:
        stream.disconnect()
        written.join()
    written.expect_no_error()


def _draw_messages(files: list[Path], scene: RerunScene, written: "_Written") -> None:
    with log_progress("rrd", files) as progress:
        drawn = bus_messages(files, {topic.name for topic in TOPICS if topic.drawn})
        for logged in progress.over(drawn):
            message = logged.message()
            if isinstance(message, MeshBlocks):
                scene.add_blocks(message)
            else:
                scene.draw(message)
            written.expect_no_error()
    scene.finish()


def _recording_id(files: list[Path]) -> str:
    """An id of the messages, independent of the path: viewers merge recordings of the same id."""
    start_ns, end_ns = log_span_ns(files)
    return f"{run_metadata(files).get('run_id', 'log')}-export-{start_ns}-{end_ns}"


def _recording_name(files: list[Path]) -> str:
    """The name in the viewer: the folder and the files."""
    first, last = files[0].resolve(), files[-1].resolve()
    return f"{first.parent.name}/{first.name}" + (f" to {last.name}" if len(files) > 1 else "")


class _Written(threading.Thread):
    """Copies the output of rerun from `pipe` to the file.

    It reads on after an error, as on a full disk: rerun would wait forever for a pipe that takes no data.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(name="rrd", daemon=True)
        self._path, self._file = path, path.open("wb")
        self._reading, self._writing = os.pipe()
        self._error: OSError | None = None
        self.pipe = f"/proc/self/fd/{self._writing}"

    def start(self) -> None:
        """Start after rerun has opened the pipe; the pipe ends when rerun closes it."""
        os.close(self._writing)
        super().start()

    def run(self) -> None:
        with os.fdopen(self._reading, "rb", buffering=0) as pipe:
            try:
                with self._file:
                    shutil.copyfileobj(pipe, self._file)
            except OSError as error:
                self._error = OSError(error.errno, error.strerror, str(self._path))
                with Path(os.devnull).open("wb") as nowhere:
                    shutil.copyfileobj(pipe, nowhere)

    def expect_no_error(self) -> None:
        if self._error is not None:
            raise self._error
