"""Requests for the mesh: answered with the newest that the mesher has published."""

import time

from hsslam_node.proto import topics
from hsslam_node.services.bus import Bus
from hsslam_node.services.request_queue import Asked
from hsslam_node.services.subscription import Received, Subscription

_PATIENCE_S = 4.0  # for the mesher to send what it keeps


class NewestMesh:
    """Listens to meshes from the first request on; before that they cost nothing."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._meshes: Subscription | None = None
        self._newest: Received | None = None
        self._world = 0
        self._waiting: list[tuple[Asked, float]] = []

    def ask(self, asked: Asked) -> None:
        """Answer as soon as there is a mesh."""
        if self._meshes is None:
            self._meshes = self._bus.subscribe(topics.MESH, 1, history=True)
        self._waiting.append((asked, time.monotonic() + _PATIENCE_S))

    def forget(self, world: int) -> None:
        """The map was thrown away: answer with meshes of the next world only."""
        self._newest, self._world = None, world

    def tick(self) -> None:
        """Take in what has come, and answer; never blocks."""
        if self._meshes is None:
            return
        while (received := self._meshes.poll_received()) is not None:
            if received.message.world >= self._world:
                self._newest = received
        still: list[tuple[Asked, float]] = []
        for asked, until_s in self._waiting:
            if self._newest is not None:
                asked.answer_payload(self._newest.payload)
            elif time.monotonic() > until_s:
                asked.refuse("not_now", "mesh: there is none yet: expected keyframes first")
            else:
                still.append((asked, until_s))
        self._waiting = still
