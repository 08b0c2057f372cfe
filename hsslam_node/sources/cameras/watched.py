"""The loop that reads a camera on this machine: frames, silence, and a camera that is unplugged."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.live_selection import selected_live
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, NoFrame, SourceLostError

_SILENCE_S = 5.0
_MOST_SILENCES = 3  # in a row: then the camera is opened again


@dataclass(frozen=True)
class WatchedCamera:
    """Raises `SourceLostError`, to be opened again, if the camera is gone or sends nothing for 15 s.

    `next_frame` waits a fraction of a second for a frame; None: there was none. `expect_there` raises
    `UserError` if the camera is not plugged in.
    """

    name: str
    next_frame: Callable[[], Frame | BadFrame | None]
    expect_there: Callable[[], object]
    should_stop: Callable[[], bool]
    lost: tuple[type[Exception], ...] = field(default=())
    """What the driver raises if the camera is gone."""
    cable: str = "cable"

    def selected(
        self, options: SourceOptions, stop: Callable[[], None]
    ) -> Iterator[Frame | BadFrame]:
        """The frames that the options select; at the end `stop` ends the driver."""
        try:
            yield from selected_live(self.frames(), options)
        finally:
            with contextlib.suppress(Exception):  # if the camera is unplugged
                stop()

    def frames(self) -> Iterator[Frame | BadFrame]:
        """Frames as they come; a `NoFrame` after each 5 s without one."""
        heard_s, silences = time.monotonic(), 0
        while not self.should_stop():
            try:
                frame = self.next_frame()
            except self.lost as error:
                raise SourceLostError(f"source {self.name}: {error}") from None
            if frame is not None:
                heard_s, silences = time.monotonic(), 0
                yield frame
            elif time.monotonic() - heard_s > _SILENCE_S:
                heard_s, silences = time.monotonic(), silences + 1
                text = f"nothing for {_SILENCE_S:g} s: check the {self.cable}"
                yield NoFrame(0, time.time_ns(), text)
                self._expect_to_hear(silences)

    def first(self, stop: Callable[[], None], within_s: float = 10.0) -> Frame:
        """The first frame, which gives size and lens; if there is none, `stop` ends the driver.

        Raises:
            UserError: there is none.
        """
        try:
            return self._first(within_s)
        except BaseException:
            with contextlib.suppress(Exception):
                stop()
            raise

    def _first(self, within_s: float) -> Frame:
        end_s, why = time.monotonic() + within_s, ""
        while time.monotonic() < end_s and not self.should_stop():
            try:
                frame = self.next_frame()
            except self.lost as error:
                raise UserError(f"source {self.name}: {error}") from None
            if isinstance(frame, Frame):
                return frame
            why = f": {frame.reason}" if frame is not None else why
        raise UserError(f"source {self.name}: no frame within {within_s:g} s{why}")

    def _expect_to_hear(self, silences: int) -> None:
        try:
            self.expect_there()
        except UserError:
            raise SourceLostError(f"source {self.name}: the camera is unplugged") from None
        if silences == _MOST_SILENCES:
            raise SourceLostError(f"source {self.name}: nothing for {silences * _SILENCE_S:g} s")
