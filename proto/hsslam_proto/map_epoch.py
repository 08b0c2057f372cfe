"""Which messages belong to the current map epoch; alone, as log and viewer share it."""

from hsslam_proto.message import Message


class EpochOrder:
    """Follows the field `map_epoch` of messages in any order.

    `now`: the newest map epoch. Messages without the field, as frames and events, belong to every epoch.
    """

    def __init__(self) -> None:
        self.now = 0

    def begins_with(self, message: Message) -> bool:
        """Whether the message is the first of a new map epoch."""
        return self.begins(getattr(message, "map_epoch", self.now))

    def begins(self, map_epoch: int) -> bool:
        """Whether this map epoch is newer than `now`; if so, it becomes `now`."""
        is_first = map_epoch > self.now
        self.now = max(map_epoch, self.now)
        return is_first

    def is_past(self, message: Message) -> bool:
        """Whether the message belongs to an earlier map epoch."""
        return getattr(message, "map_epoch", self.now) < self.now
