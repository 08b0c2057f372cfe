"""The iterations of the map that new keyframes ask for; apart from the mapper's loop, which does them."""

from hsslam_node.map.store import KeyframeStore
from hsslam_services.governor.shared_level import SharedLevel

_LONGEST = 6  # keyframes whose iterations may wait; iterations draw from older keyframes anyway


class MappingBacklog:
    """Counts the iterations that are due, at the load level of the moment.

    Args:
        iterations: for each keyframe, at load level 0.
        level: of the run.
        has_limit: as in real time, iterations of at most six keyframes wait. Those of a fragment that joins
            the map come on top, because the map has nothing of its place yet.
    """

    def __init__(self, iterations: int, level: SharedLevel, *, has_limit: bool) -> None:
        self._iterations, self._level, self._has_limit = iterations, level, has_limit
        self._seen = 0  # keyframes
        self._due = 0.0
        self._due_of_joins = 0.0  # a part of these

    def skip_to(self, keyframes: int) -> None:
        """Ask for nothing for the first `keyframes`."""
        self._seen, self._due, self._due_of_joins = keyframes, 0.0, 0.0

    def take(self, store: KeyframeStore) -> bool:
        """Take in the keyframes that have come; returns whether an iteration is due."""
        each = self._iterations * self._level.now.iterations
        self._due += each * (store.count - self._seen)
        self._due_of_joins += each * store.joined_since(self._seen)
        self._seen = store.count
        if self._has_limit:
            self._due = min(self._due, _LONGEST * each + self._due_of_joins)
        return self._due >= 1

    def next_count(self) -> int:
        """Iterations to do at once: at most those of one keyframe."""
        return min(int(self._due), max(self._iterations, 1))

    def done(self, count: int) -> None:
        """Take off iterations that were done."""
        self._due -= count
        self._due_of_joins = max(self._due_of_joins - count, 0.0)
