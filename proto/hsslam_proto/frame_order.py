"""Which frames of a camera are new; a file of its own as tracker, mapper, logs and replays share it."""

import secrets
from collections import OrderedDict
from dataclasses import dataclass
from typing import Literal

LARGEST_INDEX = 2**53  # whole numbers up to there are exact in every language that reads the bus
LARGEST_STEP = 2**20  # frames that may be missing at once: ten hours at 30 Hz
_SENDERS = 2**32  # numbers below are those of attachments: such a sender may count anew unannounced
_NAMED_FROM = 2**62
_CAMERAS = 64  # that are remembered


def new_publisher() -> int:
    """A random number of 63 bits for a camera that numbers its frames from now on."""
    return _NAMED_FROM + secrets.randbits(62)


def replayed_publisher(publisher: int, replay: int) -> int:
    """The number of a camera in a replay that drew `replay`: another in each, its own for each camera."""
    return _NAMED_FROM | (publisher ^ replay)


@dataclass(frozen=True)
class Place:
    """Where a frame stands among those of its `sender`.

    `publisher`: of the camera; a sender that counts anew without another number has another each time.
    """

    kind: Literal["new", "old", "absurd"]
    sender: int
    publisher: int
    index: int
    stamp_ns: int


class FrameOrder:
    """Follows the newest frame of each camera.

    A camera with a number of its own (`new_publisher`) counts its frames upwards. Of any other sender, a
    lower index with a later stamp is the first frame of a new count.
    """

    def __init__(self) -> None:
        self._newest: OrderedDict[int, Place] = OrderedDict()

    def place(self, publisher: int, index: int, stamp_ns: int = 0) -> Place:
        """Where a frame stands; `publisher` is 0 if nothing is known of its sender."""
        newest = self._newest.get(publisher)
        if newest is None:
            return Place("new", publisher, publisher, index, stamp_ns)
        if index > newest.index:
            kind = "absurd" if index - newest.index > LARGEST_STEP else "new"
            return Place(kind, publisher, newest.publisher, index, stamp_ns)
        if publisher >= _SENDERS or stamp_ns <= newest.stamp_ns:
            return Place("old", publisher, newest.publisher, index, stamp_ns)
        return Place("new", publisher, newest.publisher + _SENDERS, index, stamp_ns)

    def resume(self, publisher: int, index: int, stamp_ns: int) -> None:
        """Take up the newest frame of a camera, whose `publisher` is that of its `Place`."""
        sender = publisher if publisher >= _NAMED_FROM else publisher % _SENDERS
        self.take(Place("new", sender, publisher, index, stamp_ns))

    def take(self, place: Place) -> None:
        """This frame is done with: it is the newest of its sender."""
        self._newest[place.sender] = place
        self._newest.move_to_end(place.sender)
        while len(self._newest) > _CAMERAS:
            self._newest.popitem(last=False)

    def is_new(self, publisher: int, index: int, stamp_ns: int = 0) -> bool:
        """Whether a frame is new; if so, it is the newest from now on."""
        place = self.place(publisher, index, stamp_ns)
        if place.kind == "new":
            self.take(place)
        return place.kind == "new"
