"""Which blocks of a message are newer than those received before; for meshes and distances."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

Block = tuple[int, int, int]
V = TypeVar("V")
_NONE_YET = (-1, -1)


class BlockRevisions:
    """Finds the blocks of a message that are newer than those before; messages may come in any order.

    `begins_anew`: the last message began a new map epoch or series, so all blocks before it are gone.
    """

    def __init__(self) -> None:
        self.begins_anew = False
        self._epoch = _NONE_YET  # map epoch and series
        self._revisions: dict[Block, int] = {}

    @property
    def map_epoch(self) -> int:
        """Newest map epoch of the blocks; -1: no block yet."""
        return self._epoch[0]

    def begin(self, map_epoch: int) -> bool:
        """Ignore blocks of earlier map epochs from now on; returns whether this epoch is newer."""
        is_later = map_epoch > self._epoch[0]
        if is_later:
            self._epoch = (map_epoch, -1)
            self._revisions.clear()
        return is_later

    def is_past(self, map_epoch: int, series: int) -> bool:
        """Whether this map epoch and series are older than the newest."""
        return (map_epoch, series) < self._epoch

    def news(
        self, map_epoch: int, series: int, revision: int, blocks: Mapping[Block, V]
    ) -> dict[Block, V]:
        """The blocks of a message that are at least as new as those before."""
        epoch = (map_epoch, series)
        is_later = epoch > self._epoch
        self.begins_anew = is_later and self._epoch != _NONE_YET
        if is_later:
            self._epoch = epoch
            self._revisions.clear()
        if self.is_past(map_epoch, series):
            return {}
        newer = {
            block: value
            for block, value in blocks.items()
            if revision >= self._revisions.get(block, -1)
        }
        self._revisions.update(dict.fromkeys(newer, revision))
        return newer

    def forget(self, blocks: Iterable[Block]) -> None:
        """Forget the revisions of these blocks: any revision is new again."""
        for block in blocks:
            self._revisions.pop(block, None)
