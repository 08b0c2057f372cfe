"""The first frame of a recording, which is the world, reaches tracker and log."""

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_proto import topics
from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera.realtime import Realtime
from hsslam_services.launch.worker import Worker
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.options import ServeOptions
from tests.services.wire_samples import pose

_PIXELS = np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16)
_FRAME = Frame(0, 0, Camera(8, 6, 8.0, 8.0, 3.5, 2.5), *_PIXELS, 5000.0)
_BEAT_S = 0.1


class _Others:
    """Tracker and recorder of a run, as the camera hears them: the tracker answers each frame, or none."""

    def __init__(self, bus: Bus, deaf_to: int, has_log: bool, answers: bool) -> None:
        self._frames, self._poses = bus.subscribe(topics.FRAME, 8), bus.publisher(topics.POSE)
        self._health = bus.publisher(topics.HEALTH)
        self._deaf_to, self._has_log, self._answers = deaf_to, has_log, answers
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.sent = 0
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            if (frame := self._frames.wait(_BEAT_S)) is not None:
                self.sent += 1
                if self._answers:
                    self._poses.put(msgspec.structs.replace(pose(0), publisher=frame.publisher))
            self._beat("tracker", self.sent)
            self._beat("recorder", max(self.sent - self._deaf_to, 0) if self._has_log else None)

    def _beat(self, name: str, received: int | None) -> None:
        counts = {} if received is None else {"in/frame": TopicCounts(received=received)}
        self._health.put(Health(process=name, pid=1, state="running", rss_bytes=1, topics=counts))


@pytest.fixture
def sent() -> Iterator[Any]:
    """Sends the first frame to a tracker, and a recorder that is deaf to some frames: how often, seconds.

    If no frame is answered, the map is reset once the tracker has it.
    """
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "r", "camera") as bus, Bus(endpoint, "r", "other") as other:

        def send(deaf_to: int, has_log: bool = True, is_answered: bool = True) -> tuple[int, float]:
            stop = threading.Event()
            worker = SimpleNamespace(
                bus=bus, counters={}, count=lambda name: None, stop_event=lambda: stop,
                event=lambda level, text: None, should_stop=stop.is_set,
            )  # fmt: skip
            progress = CameraProgress(publisher=7)
            sensors = RobotSensors.heard(bus, ServeOptions())
            frames = bus.publisher(topics.FRAME, block=True)
            others = _Others(other, deaf_to, has_log, is_answered)
            resets = (lambda: 0) if is_answered else (lambda: others.sent)
            pace = Realtime(cast(Worker, worker), frames, progress, 1.0, sensors, resets)
            try:
                time.sleep(5 * _BEAT_S)  # the camera hears heartbeats before it sends
                begin_s = time.monotonic()
                pace.send(_FRAME)
                assert bool(progress.pinned_ns) == is_answered
                return others.sent, time.monotonic() - begin_s
            finally:
                others.close()

        yield send
    router.close()


def test_a_first_frame_that_the_recorder_misses_is_sent_again(sent):
    times, seconds = sent(deaf_to=1)
    assert times == 2 and seconds > 2


def test_a_recorder_that_never_hears_it_does_not_stop_the_run(sent):
    times, seconds = sent(deaf_to=100)
    assert times >= 2 and 5 < seconds < 15


@pytest.mark.parametrize("has_log", [True, False])
def test_a_first_frame_that_all_get_is_sent_once(sent, has_log):
    times, seconds = sent(deaf_to=0, has_log=has_log)
    assert times == 1 and seconds < 2


def test_after_a_reset_no_answer_to_a_frame_of_the_map_before_is_awaited(sent):
    times, seconds = sent(deaf_to=0, is_answered=False)
    assert times == 1 and seconds < 2
