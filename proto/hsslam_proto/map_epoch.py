"""Which messages belong to the current map epoch; a file of its own as log and viewer share it."""

from hsslam_proto.messages import Message


class EpochOrder:
    """Follows the number `world` of messages, in whatever order they come.

    `now`: the newest world. Messages without a number, as frames and events, are of any.
    """

    def __init__(self) -> None:
        self.now = 0

    def begins_with(self, message: Message) -> bool:
        """Whether the message is the first of a new world."""
        world = getattr(message, "world", self.now)
        is_first = world > self.now
        self.now = max(world, self.now)
        return is_first

    def is_past(self, message: Message) -> bool:
        """Whether the message is of a world that has ended."""
        return getattr(message, "world", self.now) < self.now
