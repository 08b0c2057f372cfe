"""Frames of a camera outside whose count jumps are refused and counted, then taken again."""

import msgspec

from hsslam_proto import topics
from hsslam_proto.frame_order import MOST_REFUSED, FrameOrder, new_publisher
from hsslam_services.bus.bus import Bus
from hsslam_services.camera.frame_inlet import FrameInlet
from hsslam_services.run.run_info import RunInfo
from tests.services.wire_samples import frame
from tests.until import until


def test_a_camera_whose_count_jumps_goes_on_after_ten_refused_frames(run_info: RunInfo):
    jumped = [2**40 + k for k in range(MOST_REFUSED + 4)]
    indices, camera = [0, 1, *jumped], new_publisher()
    with (
        Bus(run_info.endpoint, run_info.robot, "camera") as outside,
        Bus(run_info.endpoint, run_info.robot, "tracker") as bus,
    ):
        frames = bus.subscribe(topics.FRAME, len(indices))
        inlet, publisher = (
            FrameInlet(frames, FrameOrder(), None),
            outside.publisher(topics.FRAME, block=True),
        )
        until(publisher.has_subscribers, 20)
        for index in indices:
            publisher.put(msgspec.structs.replace(frame(0), index=index, publisher=camera))
        until(lambda: frames.received == len(indices), 20)
        taken = [sent.message.index for sent in _waiting(frames) if inlet.takes(sent)]
        assert taken == [0, 1, *jumped[MOST_REFUSED:]]
        assert frames.rejected == MOST_REFUSED


def _waiting(frames):
    while (received := frames.poll_received()) is not None:
        yield received
