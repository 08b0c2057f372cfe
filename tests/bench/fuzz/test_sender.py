"""Malformed messages and requests over real sessions: every one counted, none lets a good one fall."""

from hsslam_bench.fuzz.sender import PATIENT, FuzzSender, open_sending_session
from hsslam_proto.requests import REQUESTS
from hsslam_proto.topics import POSE, TOPICS
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.zenoh_session import free_endpoint, open_router
from tests.services.wire_samples import pose
from tests.until import until

COUNT = 150


def test_every_message_and_every_request_is_counted():
    endpoint = free_endpoint()
    with (
        open_router(endpoint, settings=PATIENT),  # on a busy machine 256 MiB can take a while
        Bus(endpoint, "r", "run") as bus,
        open_sending_session(endpoint) as outside,
    ):
        queue = bus.requests()
        listening = {topic.name: bus.subscribe(topic, 1) for topic in TOPICS if topic.logged}
        poses = bus.publisher(POSE)
        until(lambda: listening["out/pose"].pending() or poses.put(pose(0)), 60)
        sent = FuzzSender(outside, "r", seed=0, rate_hz=500).send(COUNT)
        until(lambda: {n: s.rejected for n, s in listening.items()} == dict(sent.messages), 60)
        assert min(sent.messages.values()) == COUNT and len(sent.messages) == len(listening)
        assert all(sent.requests[request.name] == COUNT for request in REQUESTS)
        assert sent.not_refused == 0
        assert queue.received == queue.refused == sent.refused == sent.requests.total()
        # a room for one message still holds the good one
        assert {n: s.pending() for n, s in listening.items() if s.pending()} == {"out/pose": 1}
        assert listening["out/pose"].poll() is not None and queue.poll() is None
