"""Each pose gets its frame, however far the frames are ahead."""

import msgspec

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.tracked.waiting_frames import WaitingFrames
from tests.services.wire_samples import frame, pose
from tests.until import until


def test_a_pose_gets_its_frame_though_the_next_ones_are_there(endpoint):
    frames = [frame(index) for index in range(6)]
    poses = [
        msgspec.structs.replace(pose(index), stamp_ns=frames[index].stamp_ns) for index in range(6)
    ]
    with Bus(endpoint, "r", "camera") as camera, Bus(endpoint, "r", "reader") as reader:
        waiting = WaitingFrames(reader)
        sender = camera.publisher(topics.FRAME, block=True)
        (subscription,) = reader.subscriptions
        until(sender.has_subscribers, 30)
        for sent in frames[:4]:
            sender.put(sent)
        until(lambda: subscription.received == 4, 30)
        found = [waiting.of(poses[1]), waiting.of(poses[2])]
        assert [one and one.index for one in found] == [1, 2]
        assert waiting.of(poses[0]) is None  # before one that was asked for
        for sent in frames[4:]:
            sender.put(sent)
        until(lambda: subscription.received == 6, 30)
        assert waiting.of(msgspec.structs.replace(poses[4], stamp_ns=1)) is None  # another's
        found = [waiting.of(poses[index]) for index in (3, 5)]
        assert [one and one.index for one in found] == [3, 5]
