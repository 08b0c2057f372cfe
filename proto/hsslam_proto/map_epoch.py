"""Which messages belong to the current map epoch; a file of its own as log and viewer share it."""

from hsslam_proto.message import Message


class EpochOrder:
    """Follows the number `map_epoch` of messages, in whatever order they come.

    `now`: the newest map epoch. Messages without a number, as frames and events, are of any.
    """

    def __init__(self) -> None:
        self.now = 0

    def begins_with(self, message: Message) -> bool:
        """Whether the message is the first of a new map epoch."""
        return self.begins(getattr(message, "map_epoch", self.now))

    def begins(self, map_epoch: int) -> bool:
        """Whether this is a new map epoch, which is the newest then."""
        is_first = map_epoch > self.now
        self.now = max(map_epoch, self.now)
        return is_first

    def is_past(self, message: Message) -> bool:
        """Whether the message is of a map epoch that has ended."""
        return getattr(message, "map_epoch", self.now) < self.now
