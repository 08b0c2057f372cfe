"""Figures that travel with heartbeats; alone, as it is all that the threads of a process share."""

import threading
from collections.abc import Mapping
from typing import Generic, TypeVar

N = TypeVar("N", int, float)


class HeartbeatFigures(Generic[N]):
    """Figures by name. The loop of a process writes them while its heartbeat copies them, so each access
    holds a lock: no copy sees a dict that grows, and no addition is lost."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: dict[str, N] = {}

    def __getitem__(self, name: str) -> N:
        with self._lock:
            return self._values[name]

    def __setitem__(self, name: str, value: N) -> None:
        with self._lock:
            self._values[name] = value

    def get(self, name: str, default: N) -> N:
        """The figure, or `default` where there is none of this name."""
        with self._lock:
            return self._values.get(name, default)

    def add(self, name: str, by: N) -> None:
        """Add to a figure; one that is new counts from 0."""
        with self._lock:
            self._values[name] = self._values.get(name, 0) + by

    def update(self, values: Mapping[str, N] | None = None, /, **named: N) -> None:
        """Set several at once: a heartbeat has all of them or none."""
        with self._lock:
            self._values.update(values or {}, **named)

    def copy(self) -> dict[str, N]:
        """All figures as they are now."""
        with self._lock:
            return dict(self._values)
