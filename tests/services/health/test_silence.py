"""Frames that come without a pose: how long, and not while a pause keeps them away."""

from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_services.health.silence import Silence


def _heartbeat(received: int) -> Health:
    topics = {"in/frame": TopicCounts(received=received)}
    return Health(process="tracker", pid=1, state="running", rss_bytes=0, topics=topics)


def test_a_pause_is_no_silence():
    silence = Silence()
    silence.heard(_heartbeat(1), 0.0)
    silence.posed()
    silence.heard(_heartbeat(2), 0.5)  # its pose has come before this heartbeat
    assert silence.seconds(1.0) == 0.5 and silence.seconds(5.0) == 0.0
    silence.heard(_heartbeat(3), 600.0)
    assert silence.seconds(600.2) < 1.0
    for k in range(8):
        silence.heard(_heartbeat(4 + k), 601.0 + k)
    assert silence.seconds(608.0) == 8.0
