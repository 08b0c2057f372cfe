"""The board: a Ray actor to which tasks report their progress, and which they ask whether to start."""

import msgspec


class Running(msgspec.Struct, frozen=True):
    """A task that has started: Ray's id of its node, and the number of frames that are done."""

    node_id: str
    frames: int = 0


class Board:
    """The running tasks, by index of the log. Every node calls its methods; each returns at once."""

    def __init__(self) -> None:
        self._is_closed = False
        self._running: dict[int, Running] = {}

    def begin(self, index: int, node_id: str) -> bool:
        """Register a task that starts; returns whether it may, False after `close`."""
        if not self._is_closed:
            self._running[index] = Running(node_id)
        return not self._is_closed

    def progress(self, index: int, frames: int) -> None:
        """Set the number of frames that a task has done."""
        if index in self._running:
            self._running[index] = msgspec.structs.replace(self._running[index], frames=frames)

    def end(self, index: int) -> str:
        """Remove a task that has ended or died; returns the id of its node, empty if it had not started."""
        running = self._running.pop(index, None)
        return "" if running is None else running.node_id

    def close(self) -> None:
        """Let no further task start."""
        self._is_closed = True

    def running(self) -> dict[int, Running]:
        """All tasks that have started and not ended."""
        return self._running
