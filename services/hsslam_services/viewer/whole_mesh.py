"""When the recorder asks the mesher for all blocks of the mesh, and which of the answers are drawn."""

from pathlib import Path

from hsslam_proto.envelope import Envelope
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message

_EVERY_S = 600.0  # a late viewer finds all blocks at most this long before its time
_LEAST_S = 10.0  # between two requests: the answers may fill a small part, and the next ones


class WholeMesh:
    """Schedules requests for all blocks: each part of the log and each run.<k>.rrd must open alone, except
    parts that last less than 10 s.

    A web viewer that connects late needs all blocks, too, as its server drops the oldest data.

    Args:
        part: current part of the log.
        now_s: monotonic clock, s.
    """

    def __init__(self, part: Path, now_s: float) -> None:
        self._part = part
        self._asked_s = self._drawn_s = now_s
        self._has_asked = self._is_drawn_again = self._is_in_file = False

    def is_due(self, part: Path, now_s: float) -> bool:
        """Whether to ask for all blocks now; `part`: current part of the log."""
        if now_s - self._asked_s < (_EVERY_S if part == self._part else _LEAST_S):
            return False
        self._is_in_file = part == self._part
        self._part, self._asked_s, self._has_asked = part, now_s, True
        self._is_drawn_again = now_s - self._drawn_s >= _EVERY_S
        if self._is_drawn_again:
            self._drawn_s = now_s
        return True

    def is_for_file(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether run.rrd takes the message: answers, which have no envelope, go only into a new file."""
        return not (_is_answer(message, envelope) and self._is_in_file)

    def is_for_viewer(self, message: Message, envelope: Envelope | None) -> bool:
        """Whether a viewer draws the message: it draws repeated answers only every 600 s."""
        is_repeated = _is_answer(message, envelope) and self._has_asked
        return self._is_drawn_again or not is_repeated


def _is_answer(message: Message, envelope: Envelope | None) -> bool:
    return isinstance(message, MeshBlocks) and envelope is None
