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


def test_frames_that_the_camera_process_cannot_use_are_silence():
    """As of a driver that was restarted with another profile: none reaches the tracker."""
    silence = Silence()
    silence.heard(_heartbeat(1), 0.0)
    silence.posed()
    for k in range(9):
        silence.heard(_camera(bad=3 + k, pid=7 + k // 4), float(k))  # it counts on if restarted
    assert silence.seconds(8.0) == 7.0
    for k in range(9, 20):
        silence.heard(_camera(bad=11, pid=9), float(k))
    assert silence.seconds(19.0) == 0.0


def _camera(bad: int, pid: int) -> Health:
    return Health(process="camera", pid=pid, state="running", rss_bytes=0, counters={"bad": bad})
