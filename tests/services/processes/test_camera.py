"""The camera process on a real bus: who waits for whom, resends, the sensor's clock."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.messages import Frame, MapVersion
from hsslam_proto.run_messages import Health, Hold, Step, TopicCounts
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import PROCESSES
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.run_info import RunInfo
from tests.sequence_folders import write_tum_camera
from tests.services.run.installed_package import install
from tests.services.wire_samples import frame as sample_frame

_ROOM = SynthOptions(width_px=64, height_px=48)
_CAMERA = next(spec for spec in PROCESSES if spec.name == "camera")


class _OtherEnd:
    """A client in the place of the processes that the camera talks to."""

    def __init__(self, run: RunInfo) -> None:
        self.bus = Bus(run.endpoint, run.robot, "test")
        self.frames = self.bus.subscribe(topics.FRAME, 64)
        self.end = self.bus.subscribe(topics.SOURCE_END, 1)
        self.steps = self.bus.publisher(topics.STEP)
        self.maps = self.bus.publisher(topics.MAP)
        self._health = self.bus.publisher(topics.HEALTH)
        self._beats = self.bus.subscribe(topics.HEALTH, 256)
        self.arena_dir = run.arena_dir
        self.camera = Child(_CAMERA, run.path)
        self.camera.wanted = True
        self.camera.tick()

    def camera_states(self, beats: int) -> set[str]:
        """States in so many heartbeats of the camera from now on."""
        self._beats.drain()
        states: list[str] = []
        while len(states) < beats:
            health = self._beats.wait(60)
            assert health is not None, "the camera does not beat"
            states += [health.state] if health.process == "camera" else []
        return set(states)

    def beat(self, pid: int = 1, received: int = 0) -> None:
        """Heartbeats of everybody that the camera waits for, with the frames that they have received."""
        counts = {topics.FRAME.name: TopicCounts(received=received)}
        for name in ("tracker", "mapper", "global_ba", "recorder"):
            self._health.put(
                Health(process=name, pid=pid, state="running", rss_bytes=0, topics=counts)
            )

    def next_frame(self, timeout_s: float = 60.0, received: int = 0) -> Frame:
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.beat(received=received)
            frame = self.frames.wait(0.2)
            if frame is not None:
                return frame
        raise AssertionError("no frame")

    def done(self, frame: Frame) -> None:
        """All processes are done with the frame."""
        self.steps.put(Step(stage="done", index=frame.index, publisher=frame.publisher))

    def logged(self, frame: Frame, index: int) -> None:
        """The recorder has frame `index` of that camera in its log."""
        self.steps.put(Step(stage="logged", index=index, publisher=frame.publisher))

    def expect_clean_end(self) -> None:
        deadline = time.monotonic() + 30
        while self.camera.is_alive and time.monotonic() < deadline:
            self.camera.tick()
            time.sleep(0.02)
        assert self.camera.state == "ended"
        assert self.camera.restarts == 0


@pytest.fixture
def other_end(make_run: Callable[..., RunInfo]) -> Iterator[Callable[..., _OtherEnd]]:
    started: list[_OtherEnd] = []

    def start(progress: CameraProgress | None = None, **options) -> _OtherEnd:
        """`progress`: that of a camera that was there before and died."""
        run = make_run(synth=_ROOM, **options)
        if progress is not None:
            progress.write(Path(run.arena_dir))
        started.append(_OtherEnd(run))
        return started[-1]

    yield start
    for end in started:
        end.camera.kill()
        end.bus.close()


def test_lockstep_sends_the_next_frame_only_when_the_last_is_done(other_end):
    end = other_end(pace="lockstep", frames=4)
    assert end.camera_states(beats=4) == {"starting"}  # it is there, and those it needs are not
    assert end.frames.poll() is None
    for index in range(4):
        frame = end.next_frame()
        assert frame.index == index
        assert end.frames.wait(0.2) is None
        end.steps.put(Step(stage="mapped", index=index, publisher=frame.publisher))
        end.steps.put(Step(stage="done", index=index))  # of another camera
        assert end.frames.wait(0.2) is None
        end.done(frame)
    source_end = end.end.wait(5)
    assert source_end.frame_count == 4
    end.expect_clean_end()


def test_lockstep_sends_again_to_a_restarted_process(other_end):
    end = other_end(pace="lockstep", frames=2)
    first = end.next_frame()
    end.beat(pid=2)
    again = end.frames.wait(5)
    assert (again.index, bytes(again.color)) == (first.index, bytes(first.color))


def test_lockstep_waits_for_a_recorder_that_is_behind(other_end):
    end = other_end(pace="lockstep", frames=12)
    for index in range(8):  # the recorder keeps sixteen waiting
        frame = end.next_frame()
        assert frame.index == index
        end.done(frame)
    assert end.frames.wait(1.0) is None
    end.logged(frame, index=3)
    for index in range(8, 12):
        frame = end.next_frame()
        assert frame.index == index
        end.done(frame)
    assert end.end.wait(1.0) is None
    end.beat(pid=2)  # a restarted recorder has none of them: nothing to wait for
    assert end.end.wait(10).frame_count == 12
    end.expect_clean_end()


def test_a_restarted_camera_goes_on_where_it_was(other_end):
    end = other_end(pace="lockstep", frames=5)
    for index in range(2):
        frame = end.next_frame()
        assert frame.index == index
        end.done(frame)
    assert end.next_frame().index == 2
    os.kill(end.camera.pid, 9)
    deadline = time.monotonic() + 30
    while end.camera.restarts == 0 and time.monotonic() < deadline:
        end.camera.tick()
    time.sleep(0.6)
    end.camera.tick()
    for index in range(2, 5):
        again = end.next_frame()
        assert (again.publisher, again.index) == (frame.publisher, index)
        end.done(again)
    assert end.end.wait(5).frame_count == 5


def test_realtime_holds_for_the_map_then_keeps_the_clock(other_end):
    end = other_end(frames=40, rate_hz=60.0)
    assert end.next_frame().index == 0
    assert end.frames.wait(0.5) is None
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    stamps = []
    for index in range(1, 40):
        frame = end.frames.wait(5)
        assert frame.index == index
        stamps.append(frame.stamp_ns)
        assert time.time_ns() >= frame.stamp_ns  # never ahead of the clock
    np.testing.assert_allclose(np.diff(stamps), 1e9 / 60, rtol=1e-3)
    assert end.end.wait(5).frame_count == 40
    end.expect_clean_end()


def test_the_first_frame_is_sent_again_if_the_tracker_did_not_get_it(other_end):
    end = other_end(frames=5, rate_hz=60.0)
    first = end.next_frame()
    again = end.next_frame()  # with heartbeats that count no frame
    assert (again.publisher, again.index) == (first.publisher, first.index) == (first.publisher, 0)
    begin_s = time.monotonic()
    while time.monotonic() - begin_s < 3.0:  # it is at work on it: no third one
        end.beat(received=1)
        assert end.frames.wait(0.1) is None
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    assert end.next_frame(received=1).index == 1


def test_a_paused_camera_sends_nothing_and_its_clock_stands_still(other_end):
    end = other_end(frames=40, rate_hz=20.0)
    holds = end.bus.publisher(topics.HOLD)
    assert end.next_frame().index == 0
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    last = end.frames.wait(5)
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    assert last.index < 20
    assert end.frames.wait(1.0) is None
    holds.put(Hold(paused=False))
    after = [end.frames.wait(5) for _ in range(4)]
    assert [frame.index for frame in after] == [last.index + k for k in range(1, 5)]
    assert after[0].stamp_ns - last.stamp_ns > 1e9  # what the hold took to arrive is not in it
    np.testing.assert_allclose(np.diff([f.stamp_ns for f in after]), 1e9 / 20, rtol=1e-3)


_TICKING = """
import itertools
import time
from dataclasses import replace

from hsslam_node.sources.source_row import SourceRow
from hsslam_node.sources.synth import SynthSource
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

ROW = SourceRow(kind="ticking", examples=("ticking:",), brief="a camera that counts", about="counts",
                opener="hsslam_ticking:Ticking", is_live=True)

class Ticking(SynthSource):
    def __init__(self, name, options, should_stop):
        small = SynthOptions(width_px=160, height_px=120)
        super().__init__("room", SourceOptions(frames=1, synth=small))
        self.name, self.frame_count, self._should_stop = "ticking:", None, should_stop

    def frames(self, first=0):
        image = next(super().frames(0))
        for tick in itertools.count():
            if self._should_stop():
                return
            time.sleep(0.1)
            color = image.color.copy()
            color[:] = tick % 256
            yield replace(image, index=tick, color=color)
"""


def test_after_a_pause_a_live_camera_sends_no_image_from_before_it(
    other_end, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    site = tmp_path / "site"
    install(site, "hsslam-ticking", {"hsslam_ticking": _TICKING}, {"ticking": "hsslam_ticking:ROW"})
    monkeypatch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    end = other_end(source="ticking:")
    holds = end.bus.publisher(topics.HOLD)
    last = end.next_frame()
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    holds.put(Hold(paused=False))
    first = end.frames.wait(5)
    assert _tick(first) == _tick(last) + 2  # the image between them waited for the end of the pause


def _tick(frame: Frame) -> int:
    return int(frame_from_message(frame).color[0, 0, 0])


def test_in_a_new_map_epoch_the_clock_waits_for_the_new_map(other_end):
    end = other_end(frames=40, rate_hz=20.0)
    holds, version = end.bus.publisher(topics.HOLD), 1
    assert end.next_frame().index == 0
    first_map = MapVersion(version=version, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0)
    end.maps.put(first_map)
    last = end.frames.wait(5)
    assert last.index == 1
    holds.put(Hold(paused=True))
    while (frame := end.frames.wait(0.6)) is not None:
        last = frame
    MapState(end.arena_dir).map_epoch = 1
    holds.put(Hold(paused=False))
    assert end.frames.wait(5).index == last.index + 1
    assert end.frames.wait(0.6) is None  # until there is a map
    end.maps.put(first_map)
    after = [end.frames.wait(5) for _ in range(3)]
    assert [frame.index for frame in after] == [last.index + k for k in range(2, 5)]


def test_a_recording_with_stamps_of_a_wall_clock_is_played_slowly(other_end, tum_folder):
    end = other_end(source=f"tum:{tum_folder}", rate_hz=3.0)  # a tenth of its own rate
    assert end.next_frame().index == 0
    end.maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=1, mapping_ms=0.0))
    first, second = (end.frames.wait(5) for _ in range(2))
    assert (first.index, second.index) == (1, 2)
    assert (second.stamp_ns - first.stamp_ns) / 1e9 == pytest.approx(1 / 3, abs=0.01)


def test_a_restarted_live_camera_that_had_all_its_frames_says_so(other_end):
    """It died before it could; there is no camera any more."""
    had_all = CameraProgress(next_index=4, sent=3, bad=1, last_index=2)
    end = other_end(had_all, source="ros2:/camera", frames=4)
    source_end = end.end.wait(30)
    assert (source_end.frame_count, source_end.bad_frame_count) == (3, 1)
    assert (source_end.last_index, source_end.reason) == (2, "end of source")
    end.expect_clean_end()


def test_the_end_names_the_index_of_the_last_frame_of_a_log_with_gaps(other_end, tmp_path: Path):
    (tmp_path / "logged").mkdir()
    log = PartedLog(tmp_path / "logged", "robot", LogSettings("png"))
    for sequence, index in enumerate((0, 3, 7)):
        logged = msgspec.structs.replace(sample_frame(index), publisher=5)
        log.write(topics.FRAME, encode(topics.FRAME, logged), logged.stamp_ns, 0, sequence)
    log.close()
    end = other_end(source=f"mcap:{tmp_path / 'logged'}", pace="lockstep")
    for index in (0, 3, 7):
        sent = end.next_frame()
        assert sent.index == index
        end.done(sent)
    assert end.end.wait(5).last_index == 7
    end.expect_clean_end()


def test_a_source_without_any_frame_that_can_be_used_is_bad_input(other_end, tum_folder: Path):
    write_tum_camera(tum_folder, width=128, height=96)
    end = other_end(source=f"tum:{tum_folder}")
    deadline = time.monotonic() + 30
    while end.camera.state != "failed" and time.monotonic() < deadline:
        end.beat()
        end.camera.tick()
        time.sleep(0.02)
    assert end.camera.user_error == (
        f"source tum:{tum_folder}: none of 5 frames is usable: {tum_folder}/rgb/0.png: 64x48 pixels: "
        "expected 128x96"
    )
    assert end.end.poll() is None
