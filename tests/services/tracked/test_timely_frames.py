"""A burst of frames is tracked whole; a tracker that is behind gets the newest frame."""

import time

import msgspec

from hsslam_proto import topics
from hsslam_proto.messages import Frame
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.publisher import Publisher
from hsslam_services.bus.subscription import Received, Subscription
from hsslam_services.tracked.timely_frames import DEPTH, TimelyFrames
from tests.services.wire_samples import frame
from tests.until import until

_PERIOD_NS = 33_000_000
_FAR_NS = 3_600_000_000_000


class _Camera:
    """Sends frames 33 ms apart by their stamps, as fast as it can."""

    def __init__(self, publisher: Publisher[Frame], frames: Subscription[Frame]) -> None:
        self._publisher, self._frames = publisher, frames
        until(publisher.has_subscribers)

    def burst(self, *indices: int) -> None:
        received = self._frames.received
        for index in indices:
            sent = msgspec.structs.replace(frame(index), stamp_ns=_PERIOD_NS * index)
            self._publisher.put(sent)
        until(lambda: self._frames.received == received + len(indices))


def _indices(received: list[Received[Frame] | None]) -> list[int | None]:
    return [None if one is None else one.message.index for one in received]


def test_a_burst_is_taken_whole_and_late_frames_are_dropped(endpoint: str):
    moved_ns = -_FAR_NS  # of the clock: no frame is late
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "tracker") as bus:
        frames = bus.subscribe(topics.FRAME, DEPTH)
        timely = TimelyFrames(frames, lambda: time.monotonic_ns() + moved_ns)
        camera = _Camera(outside.publisher(topics.FRAME, block=True), frames)

        camera.burst(1, 2, 3)
        assert _indices([timely.wait_received(0.0) for _ in range(4)]) == [1, 2, 3, None]
        assert frames.dropped == 0

        camera.burst(4, 5)
        moved_ns = _FAR_NS
        newer = timely.wait_received(0.0)
        assert newer is not None and (newer.message.index, newer.missed) == (5, 1)
        assert timely.wait_received(0.0) is None
        assert frames.dropped == 1

        camera.burst(6)  # late, but there is no newer one
        assert _indices([timely.wait_received(0.0)]) == [6]

        camera.burst(7, 8, 9, 10)  # one more than wait
        moved_ns = -_FAR_NS
        assert _indices([timely.wait_received(0.0) for _ in range(3)]) == [8, 9, 10]
        assert frames.dropped == 2

        camera.burst(11, 2)  # the camera has begun anew
        moved_ns = 0
        assert _indices([timely.wait_received(0.0) for _ in range(2)]) == [2, None]
