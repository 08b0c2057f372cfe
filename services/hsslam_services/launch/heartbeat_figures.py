"""Figures in heartbeats; apart, as they are the only data that a process's threads share."""

import threading
from collections.abc import Mapping
from typing import Generic, TypeVar

from hsslam_proto.message import LONGEST_NAME, MOST_FIGURES

N = TypeVar("N", int, float)
_OTHERS = "others"
_CUT = "..."


class HeartbeatFigures(Generic[N]):
    """Figures by name, guarded by a lock: the loop of a process writes them while its heartbeat thread copies
    them.

    Names may come from outside, such as topics. A name that is too long for a heartbeat loses its middle.
    If there are more names than a heartbeat may hold, the others share one figure."""

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
        """The figure of this name, or `default`."""
        with self._lock:
            return self._values.get(self._fitting(name), default)

    def add(self, name: str, by: N) -> N:
        """Add to a figure and return the sum; a new figure starts at 0."""
        with self._lock:
            name = self._fitting(name)
            self._values[name] = self._values.get(name, 0) + by
            return self._values[name]

    def update(self, values: Mapping[str, N] | None = None, /, **named: N) -> None:
        """Set several figures at once: a heartbeat has all of them or none."""
        with self._lock:
            for name, value in {**(values or {}), **named}.items():
                self._values[self._fitting(name)] = value

    def copy(self) -> dict[str, N]:
        """A copy of all figures."""
        with self._lock:
            return dict(self._values)

    def _fitting(self, name: str) -> str:
        """The name of a figure in a heartbeat."""
        if len(name) > LONGEST_NAME:
            half = (LONGEST_NAME - len(_CUT)) // 2
            name = f"{name[:half]}{_CUT}{name[-half:]}"
        has_room = name in self._values or len(self._values) < MOST_FIGURES - 1
        return name if has_room else _OTHERS
