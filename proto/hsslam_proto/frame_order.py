"""Which frames of a camera are new; tracker, mapper, logs and replays share it."""

import secrets
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal

LARGEST_INDEX = 2**53  # integers up to this are exact also in languages that have only doubles
LARGEST_STEP = 2**20  # frames that may be missing at once: ten hours at 30 Hz
MOST_REFUSED = 10  # frames in a row behind a larger step; then it is no fault of one frame
_SENDERS = 2**32  # lower numbers come from attachments: such a sender may restart its count
_NAMED_FROM = 2**62
_CAMERAS = 64  # most that are remembered


def new_publisher() -> int:
    """A random number of 63 bits for a camera that starts to count frames."""
    return _NAMED_FROM + secrets.randbits(62)


def replayed_publisher(publisher: int, replay: int) -> int:
    """The number of a camera in a replay: unique for each camera and each `replay`, a random number."""
    return _NAMED_FROM | (publisher ^ replay)


@dataclass(frozen=True)
class Place:
    """Order of a frame among the frames of its `sender`.

    `publisher`: number of the camera; if a sender restarts its count under the same number, it gets a new
    one here.
    """

    kind: Literal["new", "old", "absurd"]
    sender: int
    publisher: int
    index: int
    stamp_ns: int


@dataclass(frozen=True)
class _Camera:
    """What is known of a sender: `jump` is the last frame behind a large step, if none came after it;
    `refused` counts the frames in a row up to that one."""

    newest: Place
    jump: Place | None = None
    refused: int = 0


class FrameOrder:
    """Follows the newest frame of each camera.

    A camera with a number from `new_publisher` counts its frames upwards. From any other sender, a lower
    index with a later stamp is the first frame of a new count. A step of more than 2^20 is absurd, unless
    `refuse` was called for ten such frames in a row, which count upwards: the camera counts on from there.
    """

    def __init__(self) -> None:
        self._cameras: OrderedDict[int, _Camera] = OrderedDict()  # by sender

    def place(self, publisher: int, index: int, stamp_ns: int = 0) -> Place:
        """Order of a frame; `publisher` is 0 if its sender is unknown."""
        camera = self._cameras.get(publisher)
        if camera is None:
            return Place("new", publisher, publisher, index, stamp_ns)
        newest = camera.newest
        if index > newest.index:
            place = Place("new", publisher, newest.publisher, index, stamp_ns)
            has_moved = camera.refused >= MOST_REFUSED and _follows_jump(camera, place)
            is_absurd = _is_large_step(newest, place) and not has_moved
            return replace(place, kind="absurd") if is_absurd else place
        if publisher >= _SENDERS or stamp_ns <= newest.stamp_ns:
            return Place("old", publisher, newest.publisher, index, stamp_ns)
        return Place("new", publisher, newest.publisher + _SENDERS, index, stamp_ns)

    def resume(self, publisher: int, index: int, stamp_ns: int) -> None:
        """Set the newest frame of a camera; `publisher` as in its `Place`."""
        sender = publisher if publisher >= _NAMED_FROM else publisher % _SENDERS
        place = Place("new", sender, publisher, index, stamp_ns)
        camera = self._cameras.get(sender)
        if camera and _is_large_step(camera.newest, place):  # taken after ten refused frames
            self._cameras[sender] = replace(camera, refused=MOST_REFUSED)
        self.take(place)

    def refuse(self, place: Place) -> None:
        """Note that an absurd frame was refused."""
        camera = self._cameras[place.sender]
        refused = camera.refused + 1 if _follows_jump(camera, place) else 1
        self._cameras[place.sender] = replace(camera, jump=place, refused=refused)

    def take(self, place: Place) -> None:
        """Set this frame as the newest of its sender."""
        camera = self._cameras.get(place.sender)
        # a camera whose steps are all large, as those of a time in ns, is refused no more
        is_jump = camera is not None and _is_large_step(camera.newest, place)
        refused = camera.refused if camera else 0
        self._cameras[place.sender] = _Camera(place, place, refused) if is_jump else _Camera(place)
        self._cameras.move_to_end(place.sender)
        while len(self._cameras) > _CAMERAS:
            self._cameras.popitem(last=False)

    def is_new(self, publisher: int, index: int, stamp_ns: int = 0) -> bool:
        """Whether a frame that was not refused is new; a new frame becomes the newest."""
        place = self.place(publisher, index, stamp_ns)
        if place.kind != "old":
            self.take(place)
        return place.kind != "old"


def _follows_jump(camera: _Camera, place: Place) -> bool:
    """Whether a frame counts on from the last one behind a large step; also if it is sent again."""
    last = camera.jump
    return last is not None and last.index <= place.index and last.stamp_ns <= place.stamp_ns


def _is_large_step(newest: Place, place: Place) -> bool:
    return place.index - newest.index > LARGEST_STEP
