"""The status line: what it tells, and that it stays one line where nobody watches."""

import io
import time
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from hsslam_proto.messages import MapVersion, Pose
from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_services.health.run_state import RunState
from hsslam_services.health.status_line import StatusLine, status_text
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import PROCESSES
from tests.services.wire_samples import pose


def _pose(index: int, status: str = "tracked") -> Pose:
    stamp_ns = index * 10**8
    return msgspec.structs.replace(
        pose(index, status), stamp_ns=stamp_ns, publish_ns=stamp_ns + 25_000_000, quality=0.87
    )


def _children(run_dir: Path) -> dict[str, Child]:
    return {spec.name: Child(spec, run_dir) for spec in PROCESSES}


def test_tells_frame_rate_latency_quality_map_drops_and_health(tmp_path: Path):
    state, children = RunState(), _children(tmp_path)
    now_s = time.monotonic()
    for index in range(11):
        state.posed(_pose(index), now_s - 1.0 + index / 10)
    state.map = MapVersion(version=6, iterations=60, loss=0.1, keyframes=3, mapping_ms=20.0)
    state.last_keyframe = 2
    dropped = {"frames_dropped": 4}
    health = Health(process="tracker", pid=1, state="running", rss_bytes=1, counters=dropped)
    children["tracker"].health = health
    text = status_text(state, children).plain
    for part in ("frame 10/11 ", "10.0 FPS", "25 ms", "quality 0.87", "keyframes 3", "map 6"):
        assert part in text
    assert "dropped 4" in text
    left_out = {"sent": 11, "skipped": 3}  # by a source that is slower than its sensor was
    camera = Health(process="camera", pid=2, state="running", rss_bytes=1, counters=left_out)
    children["camera"].health = camera
    assert "dropped 7" in status_text(state, children).plain
    assert "frame 10/11 " in status_text(state, children).plain
    left_out["source_frames"] = 600
    assert "frame 10/600 " in status_text(state, children).plain
    assert all(f"{spec.name}:waiting" in text for spec in PROCESSES)
    state.posed(_pose(11, "lost"), now_s)
    assert "quality lost" in status_text(state, children).plain
    assert "lost 1" in status_text(state, children).plain


def test_the_quality_of_a_pose_goes_with_its_age_unless_poses_take_long(tmp_path: Path):
    state, now_s = RunState(), time.monotonic()
    assert state.pose_age_s(now_s) is None and state.tracking(now_s) == "none"
    for index in range(2):
        state.posed(_pose(index), now_s - 3608 + 8 * index)
    assert "quality - " in status_text(state, _children(tmp_path)).plain
    assert state.tracking(now_s - 3600 + 15) == "tracked"  # each takes 8 s, as in lockstep
    assert state.tracking(now_s - 3600 + 17) == "none"


def test_plain_output_is_one_line_now_and_then(tmp_path: Path):
    out = io.StringIO()
    with StatusLine(Console(file=out, width=40)) as line:
        for _ in range(3):
            line.show(RunState(), _children(tmp_path))
        line.say("a warning that is longer than the forty columns of this console", "warning")
    lines = out.getvalue().splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("frame -/0")


def test_a_pose_that_is_sent_again_has_no_speed():
    state = RunState()
    for _ in range(2):
        state.posed(_pose(1), 100.0)
    assert state.fps(100.0) == 0.0
    state.posed(_pose(2), 100.1)
    assert state.fps(100.1) == pytest.approx(10)


def test_frames_that_are_sent_again_count_once():
    state = RunState()
    for index in (0, 1, 2, 1, 2, 0, 3):
        state.posed(_pose(index), 100.0 + index)
    restarted = msgspec.structs.replace(_pose(0), publisher=5)  # a camera counts from 0 again
    state.posed(restarted, 104.0)
    assert (state.tracked, state.lost, state.latency_bins.cumulative()[-1]) == (5, 0, 5)
    assert state.pose is not None and state.pose.publisher == 5


def test_cameras_that_restart_for_years_take_no_memory():
    state = RunState()
    for publisher in range(1, 100):
        state.posed(_pose(5), 100.0)  # of a camera that goes on
        state.posed(msgspec.structs.replace(_pose(0), publisher=publisher), 100.0)
        state.posed(_pose(publisher + 5), 100.0)
    assert len(state.newest_index) == 64 and state.tracked == 199


def test_a_clock_that_is_set_spoils_no_latency():
    state, hour_ns = RunState(), 3600 * 10**9
    for index in range(40):
        sent = _pose(index)
        if index == 10 or index >= 30:  # once, as a frame was in flight; then for good
            sent = msgspec.structs.replace(sent, publish_ns=sent.publish_ns + hour_ns)
        if index == 20:
            sent = msgspec.structs.replace(sent, stamp_ns=sent.stamp_ns + hour_ns)
        state.posed(sent, 100 + index / 30)
    now_s = 100 + 39 / 30
    assert state.latency_ms(now_s) == pytest.approx(25)
    counted = state.latency_bins.cumulative()[-1]
    assert counted == 28 and state.latency_bins.sum_ms == pytest.approx(25 * counted)
    assert state.fps(now_s) == pytest.approx(30) and state.tracked == 40


def test_rates_age_and_silence_is_seen():
    state = RunState()
    for index in range(30):
        state.posed(_pose(index), 100 + index / 30)
    last_s = 100 + 29 / 30
    assert state.fps(last_s) == pytest.approx(30)
    assert 5 < state.fps(last_s + 3) < 10  # none came for 3 s
    assert state.latency_ms(last_s + 3) == pytest.approx(25)
    assert state.fps(last_s + 6) == state.latency_ms(last_s + 6) == 0
    assert state.tracking(last_s + 4) == "tracked"
    assert state.tracking(last_s + 6) == "none"  # no frame came either
    assert state.pose_age_s(last_s + 6) == pytest.approx(6)
    for second in range(8):
        frames = {"in/frame": TopicCounts(received=100 + second)}
        beat = Health(process="tracker", pid=7, state="running", rss_bytes=1, topics=frames)
        state.silence.heard(beat, 110.0 + second)
    assert state.silence.seconds(117.0) == pytest.approx(7)
    assert state.tracking(117.0) == "none"
    assert state.silence.seconds(121.0) == 0  # the camera was unplugged
    state.posed(_pose(40), 118.0)
    assert state.tracking(118.0) == "tracked"
    assert state.silence.seconds(118.0) == 0
