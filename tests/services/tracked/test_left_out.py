"""Frames that the service left out count as load; those that never arrived do if its own camera sent them."""

from pathlib import Path

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.tracked.left_out import LeftOutFrames
from hsslam_services.tracked.timely_frames import DEPTH
from tests.services.wire_samples import frame
from tests.until import until


def test_an_outside_camera_or_the_network_may_leave_frames_out(endpoint: str, tmp_path: Path):
    CameraProgress().write(tmp_path)
    with Bus(endpoint, "r", "camera") as camera, Bus(endpoint, "r", "tracker") as tracker:
        publisher = camera.publisher(topics.FRAME, block=True)
        frames = tracker.subscribe(topics.FRAME, DEPTH)
        until(publisher.has_subscribers)
        outside, own = LeftOutFrames(frames, None), LeftOutFrames(frames, tmp_path)

        def send(*indices: int) -> tuple[int, int]:
            received = frames.received
            for index in indices:
                publisher.put(frame(index))
            until(lambda: frames.received == received + len(indices))
            return outside.since_last(), own.since_last()

        assert send(0, 3, 6) == (0, 0)  # every third image of a driver
        publisher.sent += 5  # lost on the way
        assert send(7) == (1, 6)  # one more than wait
        frames.drain()
        frames.drop()  # a newer one waited
        assert send(8) == (1, 1)
        CameraProgress(skipped=4).write(tmp_path)  # its source was too slow
        assert send(9) == (0, 4)
        CameraProgress(skipped=9, skipped_by_wait=3).write(tmp_path)  # for three, its disk was
        assert send(10) == (0, 2)
