"""The board: an actor of Ray on which tasks write how far they are, and read whether they may begin."""

import msgspec


class Running(msgspec.Struct, frozen=True):
    """A task that has begun: its node, by Ray's id, and the frames that are done."""

    node_id: str
    frames: int = 0


class Board:
    """What runs, by index of the log. Its methods are called from everywhere and return at once."""

    def __init__(self) -> None:
        self._is_closed = False
        self._running: dict[int, Running] = {}

    def begin(self, index: int, node_id: str) -> bool:
        """A task asks whether it may begin; False after `close`."""
        if not self._is_closed:
            self._running[index] = Running(node_id)
        return not self._is_closed

    def progress(self, index: int, frames: int) -> None:
        """A task has done this many frames so far."""
        if index in self._running:
            self._running[index] = msgspec.structs.replace(self._running[index], frames=frames)

    def end(self, index: int) -> str:
        """A task has ended, in order or not; returns the id of its node, empty if it had not begun."""
        running = self._running.pop(index, None)
        return "" if running is None else running.node_id

    def close(self) -> None:
        """From now on no task begins."""
        self._is_closed = True

    def running(self) -> dict[int, Running]:
        """All tasks that have begun and not ended."""
        return self._running
