"""The frames of a log as a source: `--source mcap:run.mcap`."""

import sys
from collections.abc import Iterator

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.proto import messages
from hsslam_node.proto.frame_codec import frame_from_message
from hsslam_node.proto.topics import FRAME
from hsslam_node.services.log.log_file import bus_messages, log_parts
from hsslam_node.sources.source import BadFrame, SourceOptions

_RATE_FRAMES = 30  # the rate is told from the stamps of so many


class McapSource:
    """Frames of a log (a file, or all parts of a run folder) with the stamps that they had.

    Indices are those of the log, so that whatever is drawn at random by frame is drawn as before; a
    frame that was sent twice comes once. Colour is as the log has it: a JPEG is not what the tracker saw.

    Raises:
        UserError: no log there, none that can be read, or it holds no frame.
    """

    def __init__(self, place: str, options: SourceOptions) -> None:
        self._files = log_parts(place, lambda text: print(text, file=sys.stderr))
        self._options = options
        self.name = f"mcap:{place}"
        self.frame_count: int | None = None
        stamps_ns: list[int] = []
        first: messages.Frame | None = None
        for message in self._messages():
            first = first or message
            stamps_ns.append(message.source_stamp_ns)
            if len(stamps_ns) == _RATE_FRAMES:
                break
        if first is None:
            raise UserError(f"source mcap:{place}: holds no frames: expected a log with in/frame")
        self.camera = Camera(
            first.width_px, first.height_px, first.fx, first.fy, first.cx, first.cy
        )
        self.depth_units_per_m = first.depth_units_per_m
        period_ns = float(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else 0.0
        self.rate_hz = 1e9 / period_ns if period_ns > 0 else 30.0

    def frames(self) -> Iterator[Frame | BadFrame]:
        """Every frame of the log; one whose images cannot be decoded comes as a `BadFrame`."""
        for message in self._messages():
            try:
                yield frame_from_message(message)
            except UserError as error:
                yield BadFrame(message.index, message.source_stamp_ns, str(error))

    def _messages(self) -> Iterator[messages.Frame]:
        """Selected frames, not decoded, in order of their indices."""
        stride, most = self._options.stride, self._options.frames
        newest, seen = -1, -self._options.start
        for logged in bus_messages(self._files, {FRAME.name}):
            message = logged.message()
            assert isinstance(message, messages.Frame)
            if message.index <= newest:
                continue
            newest = message.index
            if most is not None and seen >= most * stride:
                return
            if seen >= 0 and seen % stride == 0:
                yield message
            seen += 1
