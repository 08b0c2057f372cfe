"""What a publisher keeps for those that come late: its last messages, or its state."""

import threading
import time
from collections.abc import Iterator

from hsslam_proto import topics
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.kept_messages import IncompleteStateError, get_state
from hsslam_services.bus.zenoh_session import open_client
from tests.services.bus.expect import expect
from tests.services.wire_samples import blocks, keyframe, pose
from tests.until import until


def test_late_subscribers_get_what_was_kept(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        keyframes = a.publisher(topics.KEYFRAME)
        for index in range(20):
            keyframes.put(keyframe(index))
        time.sleep(0.1)
        late = b.subscribe(topics.KEYFRAME, depth=64)
        live_only = b.subscribe(topics.KEYFRAME, depth=64, history=False)
        got = [expect(late).id for _ in range(20)]
        for index in range(20, 30):
            keyframes.put(keyframe(index))
        got += [expect(late).id for _ in range(10)]
        assert got == list(range(30))
        assert late.wait(0.3) is None
        assert [expect(live_only).id for _ in range(10)] == list(range(20, 30))


def test_what_was_kept_comes_whole_and_first_while_new_messages_come(endpoint):
    with Bus(endpoint, "r", "a") as a:
        poses = a.publisher(topics.POSE)
        for start in range(0, 600, 30):
            for index in range(start, start + 15):
                poses.put(pose(index))
            with Bus(endpoint, "r", "b") as b:
                late = b.subscribe(topics.POSE, depth=1024, history=True)
                for index in range(start + 15, start + 30):
                    poses.put(pose(index))
                    time.sleep(0.001)
                assert [expect(late).index for _ in range(start + 30)] == list(range(start + 30))
                assert late.wait(0.01) is None
                assert late.dropped == 0


def test_a_publisher_that_does_not_send_all_of_its_state_in_time_is_an_error(endpoint):
    """Else half a mesh would be taken for the whole."""
    is_over = threading.Event()

    def blocks_of_a_busy_mesher() -> Iterator[MeshBlocks]:
        yield blocks(7, 0)
        is_over.wait(30)

    with Bus(endpoint, "r", "a") as a, open_client(endpoint) as session:
        publisher = a.publisher(topics.MESH_BLOCKS)
        publisher.answer_with(blocks_of_a_busy_mesher)
        key, came = topics.MESH_BLOCKS.key("r"), []

        def fails_after_a_block() -> bool:
            came.clear()
            try:
                came.extend(get_state(session, key, timeout_s=1.0))
            except IncompleteStateError:
                return True
            return False  # the publisher is not known yet

        until(fails_after_a_block)
        assert len(came) == 1
        is_over.set()


def test_who_comes_late_asks_for_all_that_messages_amount_to(endpoint):
    with Bus(endpoint, "r", "a") as a, Bus(endpoint, "r", "b") as b:
        assert list(b.state(topics.MESH_BLOCKS)) == []  # no publisher
        publisher = a.publisher(topics.MESH_BLOCKS)
        publisher.answer_with(lambda: [blocks(7, k) for k in range(3)])
        publisher.put(blocks(7, 2))
        found = []
        until(lambda: found.extend(b.state(topics.MESH_BLOCKS)) or len(found) >= 3)
        assert [message.revision for message in found] == [7, 7, 7]
        late = b.subscribe(topics.MESH_BLOCKS, depth=8, history=True)
        assert [expect(late).revision for _ in range(3)] == [7, 7, 7]
        publisher.put(blocks(8, 2))
        assert expect(late).revision == 8
        late.ask_state()
        assert [expect(late).revision for _ in range(3)] == [7, 7, 7]
        live_only = b.subscribe(topics.MESH_BLOCKS, depth=8, history=False)
        assert live_only.wait(0.3) is None
