"""Figures that travel with heartbeats; alone, as it is all that the threads of a process share."""

import threading
from collections.abc import Mapping
from typing import Generic, TypeVar

from hsslam_proto.message import LONGEST_NAME, MOST_FIGURES

N = TypeVar("N", int, float)
_OTHERS = "others"
_CUT = "..."


class HeartbeatFigures(Generic[N]):
    """Figures by name. The loop of a process writes them while its heartbeat copies them, so each access
    holds a lock: no copy sees a dict that grows, and no addition is lost.

    Names may come from outside, as those of topics do. One that is too long for a heartbeat loses its middle,
    and names beyond the most that a heartbeat takes share one figure."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: dict[str, N] = {}

    def __getitem__(self, name: str) -> N:
        with self._lock:
            return self._values[self._fitting(name)]

    def __setitem__(self, name: str, value: N) -> None:
        with self._lock:
            self._values[self._fitting(name)] = value

    def get(self, name: str, default: N) -> N:
        """The figure, or `default` where there is none of this name."""
        with self._lock:
            return self._values.get(self._fitting(name), default)

    def add(self, name: str, by: N) -> N:
        """Add to a figure and return it; one that is new counts from 0."""
        with self._lock:
            name = self._fitting(name)
            self._values[name] = self._values.get(name, 0) + by
            return self._values[name]

    def update(self, values: Mapping[str, N] | None = None, /, **named: N) -> None:
        """Set several at once: a heartbeat has all of them or none."""
        with self._lock:
            for name, value in {**(values or {}), **named}.items():
                self._values[self._fitting(name)] = value

    def copy(self) -> dict[str, N]:
        """All figures as they are now."""
        with self._lock:
            return dict(self._values)

    def _fitting(self, name: str) -> str:
        """The name that a heartbeat has for it."""
        if len(name) > LONGEST_NAME:
            half = (LONGEST_NAME - len(_CUT)) // 2
            name = f"{name[:half]}{_CUT}{name[-half:]}"
        has_room = name in self._values or len(self._values) < MOST_FIGURES - 1
        return name if has_room else _OTHERS
