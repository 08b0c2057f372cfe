"""A log for the rerun viewer, with its mesh; apart from `export`, so that rerun comes with it only."""

from collections.abc import Iterator
from pathlib import Path

import rerun as rr

from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.topics import TOPICS
from hsslam_services.commands.log.progress import log_progress
from hsslam_services.log.reader import bus_messages
from hsslam_services.viewer.layout import blueprint
from hsslam_services.viewer.scene import RerunScene


def export_rrd(files: list[Path], path: Path) -> Iterator[str]:
    """Draw every message that the viewer shows, none thinned out; yields what it wrote.

    Raises:
        OSError: the file cannot be written.
    """
    path.write_bytes(b"")  # rerun raises no OSError
    stream = rr.RecordingStream("hsslam", recording_id=f"{files[0].parent.name}-export")
    stream.set_sinks(rr.FileSink(path), default_blueprint=blueprint())
    scene = RerunScene(stream, poses_every_s=1.0)
    with log_progress("rrd", files) as progress:
        drawn = bus_messages(files, {topic.name for topic in TOPICS if topic.drawn})
        for logged in progress.over(drawn):
            message = logged.message()
            if isinstance(message, MeshBlocks):
                scene.add_blocks(message)
            else:
                scene.draw(message)
    scene.finish()
    stream.flush()
    stream.disconnect()
    yield f"{path}: {path.stat().st_size / 1e6:.1f} MB"
