"""Frames of a client whose link takes longer for one than zenoh waits by itself."""

import time

import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from tests.services.slow_link import slow_link
from tests.services.wire_samples import frame
from tests.until import until

_FRAMES = 5


@pytest.mark.parametrize("compressed", [False, True])
def test_frames_arrive_over_a_slow_link(endpoint, compressed):
    """Raw ones of 1.5 MB take 0.12 s of it."""
    alone = {"transport/shared_memory/enabled": False}
    with (
        slow_link(endpoint, mbit_s=100) as far,
        Bus(endpoint, "r", "tracker") as inside,
        Bus(far, "r", "outside-camera", settings=alone) as outside,
    ):
        heard, frames = inside.subscribe(topics.FRAME, 64), outside.publisher(topics.FRAME)
        until(frames.has_subscribers)
        for index in range(_FRAMES):
            frames.put(frame(index, compressed, width_px=640, height_px=480))
            time.sleep(0.2)
        until(lambda: heard.pending() == _FRAMES)
        assert [message.index for message in heard.drain()] == list(range(_FRAMES))
