"""Which blocks of a message are news; a file of its own as meshes and distances come in blocks."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

Block = tuple[int, int, int]
V = TypeVar("V")
_NONE_YET = (-1, -1)


class BlockRevisions:
    """Says which blocks of a message are news, in whatever order messages come; memory is that of the blocks.

    `begins_anew`: whether blocks that were sent before the last message are gone, with their sender or map.
    """

    def __init__(self) -> None:
        self.begins_anew = False
        self._epoch = _NONE_YET  # map epoch and series
        self._revisions: dict[Block, int] = {}

    @property
    def map_epoch(self) -> int:
        """Of the blocks that are taken now; -1: there were none yet."""
        return self._epoch[0]

    def begin(self, map_epoch: int) -> bool:
        """Take no more blocks of earlier map epochs; whether there were any."""
        is_later = map_epoch > self._epoch[0]
        if is_later:
            self._epoch = (map_epoch, -1)
            self._revisions.clear()
        return is_later

    def is_past(self, map_epoch: int, series: int) -> bool:
        """Whether blocks of this map epoch and series are gone."""
        return (map_epoch, series) < self._epoch

    def news(
        self, map_epoch: int, series: int, revision: int, blocks: Mapping[Block, V]
    ) -> dict[Block, V]:
        """The blocks of a message that are newer than those before."""
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
        """Whatever comes of these blocks is news again."""
        for block in blocks:
            self._revisions.pop(block, None)
