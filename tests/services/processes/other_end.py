"""A client in the place of the processes that the camera talks to, for tests of the camera process."""

import time

from hsslam_proto import topics
from hsslam_proto.messages import Frame
from hsslam_proto.run_messages import Health, Step, TopicCounts
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import PROCESSES
from hsslam_services.run.run_info import RunInfo

_CAMERA = next(spec for spec in PROCESSES if spec.name == "camera")


class OtherEnd:
    """A client in the place of the processes that the camera talks to."""

    def __init__(self, run: RunInfo, *, starts_camera: bool = True) -> None:
        """Without `starts_camera` there is no process: the test runs the camera's loop itself."""
        self.bus = Bus(run.endpoint, run.robot, "test")
        self.frames = self.bus.subscribe(topics.FRAME, 64)
        self.end = self.bus.subscribe(topics.SOURCE_END, 1)
        self.steps = self.bus.publisher(topics.STEP)
        self.maps = self.bus.publisher(topics.MAP)
        self._health = self.bus.publisher(topics.HEALTH)
        self._beats = self.bus.subscribe(topics.HEALTH, 256)
        self.arena_dir = run.arena_dir
        self.camera = Child(_CAMERA, run.path)
        self.camera.wanted = starts_camera
        self.camera.tick()

    def camera_states(self, beats: int) -> set[str]:
        """States in the next `beats` heartbeats of the camera."""
        self._beats.drain()
        states: list[str] = []
        while len(states) < beats:
            health = self._beats.wait(60)
            assert health is not None, "the camera does not beat"
            states += [health.state] if health.process == "camera" else []
        return set(states)

    def counter(self, name: str) -> int:
        """A counter in the next heartbeat of the camera."""
        self._beats.drain()
        while True:
            health = self._beats.wait(60)
            assert health is not None, "the camera does not beat"
            if health.process == "camera":
                return health.counters.get(name, 0)

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
