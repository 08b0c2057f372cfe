"""Pacing of a recording with gaps, steps back and a wall clock that is set."""

import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.source import LateFrame
from hsslam_proto import topics
from hsslam_proto.messages import Frame as FrameMessage
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera import wall_clock
from hsslam_services.camera.prefetch import Prefetch
from hsslam_services.camera.realtime import Realtime
from hsslam_services.launch.worker import Worker
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.options import ServeOptions
from tests.until import until

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_PIXELS = np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16)


class _Clock:
    """A wall clock that can be set; the monotonic one is that of the machine."""

    def __init__(self) -> None:
        self.set_by_ns = 0
        self.monotonic_ns = time.monotonic_ns

    def time_ns(self) -> int:
        return time.time_ns() + self.set_by_ns


@pytest.fixture
def paced() -> Iterator[Callable[[list[float]], tuple[list[FrameMessage], list[str], float]]]:
    """Sends frames of these stamps (s): what came, what was told, and how long it took."""
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "r", "camera") as bus, Bus(endpoint, "r", "other") as other:
        came = other.subscribe(topics.FRAME, 64)
        told: list[str] = []
        stop = threading.Event()
        counters: dict[str, int] = {}

        def tell(level: str, text: str) -> None:
            if "delivers frames too slowly" not in text:  # this machine paused for a second
                told.append(text)

        worker = SimpleNamespace(
            bus=bus,
            counters=counters,
            count=lambda name: counters.update({name: counters.get(name, 0) + 1}),
            event=tell,
            stop_event=lambda: stop,
            should_stop=stop.is_set,
        )
        progress = CameraProgress(pinned_source_ns=0, pinned_ns=time.monotonic_ns())
        sensors = RobotSensors.heard(bus, ServeOptions())
        frames = bus.publisher(topics.FRAME, block=True)
        until(frames.has_subscribers)
        pace = Realtime(cast(Worker, worker), frames, progress, 1.0, sensors, lambda: 0)

        def send(stamps_s: list[float]) -> Any:
            progress.pinned_ns = time.monotonic_ns() - round(stamps_s[0] * 1e9)
            progress.last_source_ns = -1
            begin_s = time.monotonic()
            found = []
            for index, stamp_s in enumerate(stamps_s):
                pace.send(Frame(index, round(stamp_s * 1e9), _CAMERA, *_PIXELS, 5000.0))
                progress.last_source_ns = round(stamp_s * 1e9)
                found.append(came.wait(10.0))
            return found, told, time.monotonic() - begin_s

        yield send
    router.close()


def test_a_gap_of_an_hour_is_waited_for_a_second(paced):
    found, told, took_s = paced([0.0, 0.1, 3600.0, 3600.1])
    assert took_s < 10
    assert len(found) == 4
    assert len(told) == 1
    assert "frame 2: the stamps have a gap of 359" in told[0]
    assert "waits 1 s" in told[0]
    assert [frame.source_stamp_ns for frame in found][2] == 3600 * 10**9


@pytest.mark.parametrize("step_s", [0.0, 1e-9])
def test_frames_with_the_same_stamp_come_a_period_apart(paced, step_s):
    """As of a clock of whole seconds, or of a recorder that stamps in bursts."""
    stamps_s = [0.0, 0.5, *(0.5 + k * step_s for k in range(1, 6)), 1.0]
    found, told, seconds = paced(stamps_s)
    sent_s = 1e-9 * np.array([message.stamp_ns for message in found])
    if seconds < 1.5:  # else this machine paused
        apart_s = [0.5, *[1 / 30] * 5, 0.5 - 5 / 30]
        np.testing.assert_allclose(np.diff(sent_s), apart_s, atol=0.02)
    assert seconds >= 1.0
    assert told == [
        "frame 2: its stamp is that of the frame before: such frames are sent 33 ms apart"
    ]


def test_stamps_that_step_back_are_told_and_the_clock_goes_on(paced):
    found, told, took_s = paced([100.0, 100.1, 50.0, 50.1, 50.2])
    assert took_s < 10
    assert told == ["frame 2: its stamp is 50.1 s before the previous one"]
    assert found[4].stamp_ns - found[2].stamp_ns >= 0.19e9  # paced again


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_wall_clock_that_is_set_moves_stamps_and_not_the_pace(paced, monkeypatch, hours):
    clock = _Clock()
    monkeypatch.setattr(wall_clock, "time", clock)
    before, told, _ = paced([0.0, 0.1])
    clock.set_by_ns = hours * 3600 * 10**9
    after, told, took_s = paced([0.0, 0.1, 0.2])
    assert took_s < 5
    assert len(told) == 1
    assert f"the wall clock was set by {hours * 3600:+.1f} s" in told[0]
    moved_s = (after[0].stamp_ns - before[1].stamp_ns) / 1e9
    assert abs(moved_s - hours * 3600) < 30


_RATE_HZ = 50.0


class _SlowSource:
    """Takes `times` as long for a frame as its sensor did, but for late ones, which it leaves out."""

    def __init__(self, times: float, stamps_s: np.ndarray) -> None:
        self._seconds = times / _RATE_HZ
        self._stamps_ns = np.round(1e9 * stamps_s).astype(np.int64).tolist()

    def frames_in_time(self, first: int, is_late: Callable[[int, int], bool]) -> Iterator[Any]:
        for index, stamp_ns in enumerate(self._stamps_ns[first:], first):
            if is_late(index, stamp_ns):
                yield LateFrame(index, stamp_ns)
                continue
            time.sleep(self._seconds)
            yield Frame(index, stamp_ns, _CAMERA, *_PIXELS, 5000.0)


@pytest.fixture
def played() -> Iterator[Callable[..., list[tuple[Any, float]]]]:
    """Plays a source to its end: each item, and by how much it was sent too late, s (late frames: 0). The
    items before number `before_map` come while there is no map, and are left out."""
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "r", "camera") as bus:
        progress = CameraProgress(pinned_source_ns=0, pinned_ns=time.monotonic_ns())
        sensors = RobotSensors.heard(bus, ServeOptions())
        stop = threading.Event()
        worker = SimpleNamespace(
            bus=bus, counters={"clock_shifts": 0}, count=lambda name: None, stop_event=lambda: stop,
            event=lambda level, text: None, should_stop=stop.is_set,
        )  # fmt: skip
        frames = bus.publisher(topics.FRAME)
        pace = Realtime(
            cast(Worker, worker), frames, progress, 1.0, sensors, lambda: 0, 1 / _RATE_HZ
        )

        def play(source: _SlowSource, before_map: int = 0) -> list[tuple[Any, float]]:
            progress.pinned_ns = 0 if before_map else time.monotonic_ns()
            progress.last_source_ns, sent = -1, []
            for item in Prefetch(source.frames_in_time(0, pace.is_late), 3):
                behind_s = 0.0
                if item.index < before_map:
                    stop.set()  # else it waits for the tracker's answer
                    pace.send(item)
                    stop.clear()
                    progress.last_source_ns = item.stamp_ns
                    if item.index == before_map - 1:
                        progress.pinned_source_ns = item.stamp_ns
                        progress.pinned_ns = time.monotonic_ns()
                    continue
                if isinstance(item, Frame):
                    pace.send(item)
                    behind_s = (time.monotonic_ns() - progress.due_ns(item.stamp_ns, 1.0)) / 1e9
                    progress.last_source_ns = item.stamp_ns
                sent.append((item, behind_s))
            return sent

        yield play
    router.close()


def test_a_source_that_is_too_slow_leaves_out_frames_and_does_not_fall_behind(played):
    sent = played(_SlowSource(2.5, np.arange(100) / _RATE_HZ))
    assert [item.index for item, _ in sent] == list(range(100))
    late = [item for item, _ in sent if isinstance(item, LateFrame)]
    assert 40 <= len(late) <= 80  # 60 are too many
    behind_s = sorted(behind for item, behind in sent if isinstance(item, Frame))
    assert behind_s[len(behind_s) // 2] < 4 / _RATE_HZ  # reading one takes 2.5 of these


def test_a_source_that_is_fast_enough_leaves_out_nothing(played):
    sent = played(_SlowSource(0.2, np.arange(30) / _RATE_HZ))
    assert sum(isinstance(item, LateFrame) for item, _ in sent) <= 2  # this machine paused


def test_frames_after_a_step_back_are_not_late(played):
    stamps_s = np.concatenate([0.5 + np.arange(20) / _RATE_HZ, np.arange(20) / _RATE_HZ])
    sent = played(_SlowSource(0.2, stamps_s))
    assert sum(isinstance(item, LateFrame) for item, _ in sent) <= 2  # this machine paused


def test_a_step_back_before_the_first_map_leaves_frames_out_that_are_late(played):
    stamps_s = np.concatenate([0.5 + np.arange(3) / _RATE_HZ, np.arange(100) / _RATE_HZ])
    sent = played(_SlowSource(2.5, stamps_s), before_map=4)
    assert sum(isinstance(item, LateFrame) for item, _ in sent) >= 40
