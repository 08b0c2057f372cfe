"""Writes short logs of any source without a run.

`python -m hsslam_bench.batch.small_log FOLDER COUNT` writes COUNT logs of the built-in room, all with the
same single frame.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.topics import FRAME
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog

_START_NS = 1_700_000_000_000_000_000


def main() -> None:
    parser = argparse.ArgumentParser(prog="batch.small_log", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("count", type=int)
    arguments = parser.parse_args()
    first = write_small_log(arguments.folder / "0", count=1)
    for k in range(1, arguments.count):
        (arguments.folder / str(k)).mkdir()
        shutil.copy(first, arguments.folder / str(k))


def write_small_log(folder: Path, start: int = 0, count: int = 6) -> Path:
    """Write `count` frames of the room, 160 x 120, from index `start` on, as a run would log them."""
    small = SynthOptions(width_px=160, height_px=120)
    options = SourceOptions(start=start, frames=count, synth=small)
    return write_log(folder, "synth:room", options)


def write_logs(folder: Path, sources: Sequence[str], each: int, frames: int, step: int) -> None:
    """Write `each` logs of each source below a folder; each starts `step` frames after the previous one.

    Raises:
        UserError: as `write_log`.
    """
    for number, source in enumerate(sources):
        for k in range(each):
            options = SourceOptions(start=step * k, frames=frames)
            write_log(folder / f"{number}.{k}", source, options)


def write_log(folder: Path, source: str, options: SourceOptions) -> Path:
    """Write the frames of a source as a run would log them; returns the file.

    Raises:
        UserError: the source is missing or not readable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = PartedLog(folder, "robot", LogSettings("png"))
    for index, frame in enumerate(open_source(source, options).frames()):
        assert isinstance(frame, Frame)
        at_ns = _START_NS + frame.stamp_ns
        message = compress_frame(frame_message(frame, at_ns), "png")
        log.write(FRAME, encode(FRAME, message), at_ns, at_ns, index)
    log.close()
    return folder / "run.mcap"


if __name__ == "__main__":
    main()
