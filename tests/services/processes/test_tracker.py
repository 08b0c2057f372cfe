"""The tracker process: every frame gets an answer where all wait for one."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map import pose_log
from hsslam_node.map.pose_log import LOST, TRACKED, PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import PRESETS
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.frame_order import FrameOrder, Place, new_publisher
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.artefacts.lost_results import POSES_NOT_LOGGED
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.tracker import _run, _TrackerLoop
from hsslam_services.run.run_info import RunInfo
from hsslam_services.tracked.events import TrackingEvents
from hsslam_services.tracked.poses_out import PosesOut, Received
from tests.small_room import SMALL, room_frames, room_poses
from tests.until import until

_CAMERA = 7  # its number
_IN_TURN = "frames of another camera in turn"
_STOOD_STILL = "frames whose source_stamp_ns did not grow"


def test_a_frame_that_cannot_be_used_is_lost_in_lockstep(make_run: Callable[..., RunInfo]):
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    frames = _frames_of(160, 4)
    for k in (1, 2):
        frames[k] = replace(frames[k], camera=replace(frames[k].camera, fx=999.0))
    frames[3] = replace(frames[3], stamp_ns=frames[2].stamp_ns)
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        order = FrameOrder()
        loop = _TrackerLoop(worker, worker.bus.subscribe(topics.FRAME, 4), order)
        begin_s = time.monotonic()
        for frame in frames:
            message = frame_message(frame, time.time_ns(), _CAMERA)
            place = order.place(_CAMERA, frame.index, message.stamp_ns)
            loop.take(message, time.time_ns(), place)
        loop.finish()
        rows = PoseLog(worker.arena).rows()
        assert rows["index"].tolist() == [0, 1, 2, 3]
        assert rows["status"][1:].tolist() == [LOST, LOST, TRACKED]
        seconds = 1e-9 * rows["publish_monotonic_ns"]
        assert (np.diff([begin_s, *seconds, time.monotonic()]) >= 0).all()
        assert worker.counters["unusable frames"] == 2
        assert worker.counters[_STOOD_STILL] == 1


def test_poses_that_do_not_fit_into_memory_are_published_and_reported_once(
    make_run: Callable[..., RunInfo], monkeypatch: pytest.MonkeyPatch
):
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        poses, events = (worker.bus.subscribe(topic, 8) for topic in (topics.POSE, topics.EVENT))
        out = PosesOut(
            worker, SharedMap(worker.arena, PRESETS["realtime"]), MapState(run.arena_dir)
        )
        monkeypatch.setattr(pose_log, "SLAB_ROWS", 1)
        monkeypatch.setattr(PoseLog, "_slab", _one_slab)
        for index in range(4):
            message = frame_message(_frames_of(160, 1)[0], time.time_ns(), _CAMERA)
            place = FrameOrder().place(_CAMERA, index, message.stamp_ns)
            now_ns = time.time_ns()
            received = Received(message, place, now_ns, now_ns, now_ns, 0)
            out.put(TrackResult.without_map(index), received)
        until(lambda: poses.received == 4, 60)
        assert worker.counters[POSES_NOT_LOGGED] == 3
        worker.counters[POSES_NOT_LOGGED] = 0
        PosesOut(worker, SharedMap(worker.arena, PRESETS["realtime"]), MapState(run.arena_dir))
        assert worker.counters[POSES_NOT_LOGGED] == 3  # a restarted tracker goes on counting
        told = [event.text for event in events.drain()]
    assert told == ["the memory is full: poses are published, but missing in the trajectories"]


def test_a_pose_of_a_fragment_says_that_odometry_alone_placed_it(make_run: Callable[..., RunInfo]):
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        poses = worker.bus.subscribe(topics.POSE, 8)
        out = PosesOut(
            worker, SharedMap(worker.arena, PRESETS["realtime"]), MapState(run.arena_dir)
        )
        message = frame_message(_frames_of(160, 1)[0], time.time_ns(), _CAMERA)
        for index, is_reckoned in enumerate((False, True)):
            place = FrameOrder().place(_CAMERA, index, message.stamp_ns)
            result = replace(
                TrackResult.without_map(index), keyframe=0, fragment=1, is_reckoned=is_reckoned
            )
            out.put(result, Received(message, place, *3 * [time.time_ns()], 0))
            heard = poses.wait(20.0)
            assert heard is not None and (heard.status, heard.fragment) == ("lost", 1)
            assert heard.is_dead_reckoned == is_reckoned


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_a_restarted_tracker_goes_on_with_an_index_that_is_a_time_in_ns(
    make_run: Callable[..., RunInfo], frames: int
):
    run = make_run(slam=PRESETS["realtime"])
    camera, message = new_publisher(), frame_message(_frames_of(160, 1)[0], 1, _CAMERA)
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        out = PosesOut(
            worker, SharedMap(worker.arena, PRESETS["realtime"]), MapState(run.arena_dir)
        )
        for index in range(0, frames * 33_333_333, 33_333_333):
            place = FrameOrder().place(camera, index, message.stamp_ns)
            out.put(TrackResult.without_map(index), Received(message, place, *3 * [1], 0))
        order = FrameOrder()
        _TrackerLoop(worker, worker.bus.subscribe(topics.FRAME, 4), order)
        kind = order.place(camera, 100_000_000, message.stamp_ns + 1).kind
    assert kind == (
        "absurd" if frames == 1 else "new"
    )  # one frame does not show the camera's steps


def test_a_fragment_that_joined_as_its_tracker_died_keeps_its_poses(
    make_run: Callable[..., RunInfo],
):
    """The map has the fragment's keyframe, and the log does not say yet that it joined."""
    run, frame = make_run(source="zenoh:", slam=SMALL), room_frames()[0]
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        store = KeyframeStore.create(worker.arena, frame.camera, frame.depth_units_per_m, 16)
        store.append(frame, np.eye(4))
        log = PoseLog(worker.arena)
        log.append(_lost_in_fragment(1))
        staging = store.staging()
        staging.add(frame)
        log.prepare_join(1, np.array([store.count]), np.eye(4)[None])
        one, sure = np.eye(4)[None], np.zeros((1, 6, 6))
        store.append_staged(staging, one, sure, sure, 1)
        assert log.joined(log.rows())["status"].tolist() == [LOST]
        _TrackerLoop(worker, worker.bus.subscribe(topics.FRAME, 4), FrameOrder())
        assert log.joined(log.rows())["status"].tolist() == [TRACKED]


def _lost_in_fragment(fragment: int) -> np.ndarray:
    T = np.eye(4)
    return pose_log.pose_row(
        index=0, source_stamp_ns=0, stamp_ns=0, publish_ns=0, status=LOST, keyframe=0, T_world_cam=T,
        T_keyframe_cam=T, quality=0.0, map_version=0, publisher=_CAMERA, fragment=fragment,
    )  # fmt: skip


def _one_slab(log: PoseLog, k: int, slab=PoseLog._slab) -> np.ndarray:
    """The memory has room for the first slab alone."""
    if k:
        raise OutOfMemoryError("/dev/shm is full")
    return slab(log, k)


def test_a_frame_that_is_sent_again_gets_its_pose_and_another_of_its_number_gets_none(
    make_run: Callable[..., RunInfo],
):
    """As of a driver that counts from 0 again and keeps its number."""
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    first, second = _frames_of(160, 2)
    another = replace(first, stamp_ns=second.stamp_ns + 10**9)
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        poses, order, camera = worker.bus.subscribe(topics.POSE, 8), FrameOrder(), new_publisher()
        loop = _TrackerLoop(worker, worker.bus.subscribe(topics.FRAME, 4), order)
        found = []
        for frame in (first, second, another, first):
            message = frame_message(frame, time.time_ns(), camera)
            loop.take(message, time.time_ns(), order.place(camera, frame.index, message.stamp_ns))
            if frame is not another:
                found.append(poses.wait(20.0))
        assert [pose and pose.source_stamp_ns for pose in found] == [
            first.stamp_ns, second.stamp_ns, first.stamp_ns
        ]  # fmt: skip
        assert found[0] and found[2] and found[2].publish_ns == found[0].publish_ns
        assert worker.counters["late frames"] == 1


def test_a_camera_that_changes_is_reported_and_its_frames_count_as_dropped(
    make_run: Callable[..., RunInfo],
):
    """The first frame is too small to track; from the third on, the camera has another resolution."""
    run = make_run(slam=PRESETS["realtime"])
    usual, changed = _frames_of(160, 2), _frames_of(80, 11)
    camera = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
    color, depth_raw = np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), np.uint16)
    tiny = replace(usual[0], camera=camera, color=color, depth_raw=depth_raw)
    sent = [replace(frame, index=k) for k, frame in enumerate([tiny, *usual, *changed])]
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        frames, events = (
            worker.bus.subscribe(topics.FRAME, 4),
            worker.bus.subscribe(topics.EVENT, 64),
        )
        order = FrameOrder()
        loop = _TrackerLoop(worker, frames, order)
        for frame in sent:
            message = frame_message(frame, time.time_ns(), _CAMERA)
            loop.take(message, time.time_ns(), order.place(_CAMERA, frame.index, message.stamp_ns))
        assert PoseLog(worker.arena).rows()["index"].tolist() == [1, 2]
        assert frames.dropped == worker.counters["unusable frames"] == 12
        told: list[str] = []
        while not told or not told[-1].startswith("10 frames"):
            event = events.wait(20.0)
            assert event is not None, told
            told += [event.text] * (event.level == "warning")
    assert told[0].startswith("frame 0 dropped: images of 8x6 pixels: expected at least 8 a side")
    assert told[-1].startswith("10 frames in a row dropped; the last, frame 12: ")


def test_frames_that_come_while_no_tracker_runs_count_as_dropped(make_run: Callable[..., RunInfo]):
    run = make_run(source="zenoh:", slam=PRESETS["realtime"])
    sent = iter(_frames_of(160, 12))
    with Bus(run.endpoint, run.robot, "camera") as bus:
        camera, poses = bus.publisher(topics.FRAME, block=True), bus.subscribe(topics.POSE, 16)

        def send(count: int) -> None:
            for frame in (next(sent) for _ in range(count)):
                camera.put(frame_message(frame, time.time_ns(), _CAMERA))

        for dropped, meanwhile in ((0, 5), (5, 3), (8, 0)):
            with _tracker(run) as worker:
                until(camera.has_subscribers)
                send(1)
                assert poses.wait(60.0) is not None
                until(lambda: worker.counters.get("frames_dropped", -1) == dropped)  # noqa: B023
            until(lambda: not camera.has_subscribers())
            send(meanwhile)


def test_fragments_are_saved_before_a_tracker_ends_by_an_exception(
    make_run: Callable[..., RunInfo], monkeypatch: pytest.MonkeyPatch
):
    """The write of fragment 1 takes until the file is read."""
    run = make_run(source="zenoh:", slam=SMALL)
    slow = run.path / "map_fragment_1.safetensors"
    os.mkfifo(slow)
    has_failed = threading.Event()

    def take(loop: _TrackerLoop, *_: object) -> bool:
        for number in (1, 2):
            fragment = Fragment(SMALL, room_frames()[0], 0, number, 8)
            fragment.store.append(room_frames()[0], room_poses()[0])
            loop.fragments.save(fragment)
        has_failed.set()
        raise ValueError("a fault")

    def ends_by_it(worker: Worker) -> None:
        with pytest.raises(ValueError, match="a fault"):
            _run(worker)

    monkeypatch.setattr(_TrackerLoop, "take", take)
    with (
        Bus(run.endpoint, run.robot, "camera") as bus,
        Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker,
    ):
        camera = bus.publisher(topics.FRAME, block=True)
        running = threading.Thread(target=ends_by_it, args=(worker,))
        running.start()
        until(camera.has_subscribers)
        camera.put(frame_message(_frames_of(160, 1)[0], time.time_ns(), _CAMERA))
        assert has_failed.wait(20)
        running.join(0.5)
        assert running.is_alive()
        assert slow.read_bytes()
        running.join(20)
    assert (run.path / "map_fragment_2.safetensors").is_file()


@contextmanager
def _tracker(run: RunInfo) -> Iterator[Worker]:
    """A tracker process, in threads of this one."""
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = threading.Thread(target=_run, args=(worker,))
        loop.start()
        try:
            yield worker
        finally:
            worker.stop_event().set()
            loop.join()


def test_two_cameras_in_turn_are_reported_and_one_that_restarts_is_not(
    make_run: Callable[..., RunInfo],
):
    run = make_run()
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        events = TrackingEvents(worker, SharedMap(worker.arena, worker.options.slam))
        for index, camera in enumerate((7, 7, 8, 8, 9)):
            events.heard(Place("new", camera, camera, index, 1), index)
        assert worker.counters.get(_IN_TURN, 0) == 0
        for index, camera in enumerate((8, 9, 8), 5):
            events.heard(Place("new", camera, camera, index, 1), index)
        assert worker.counters[_IN_TURN] == 3


def test_a_clock_of_the_source_that_stands_still_is_counted(make_run: Callable[..., RunInfo]):
    """The driver sends 0 in each frame; another camera begins wherever its own clock is."""
    run = make_run()
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        events = TrackingEvents(worker, SharedMap(worker.arena, worker.options.slam))
        for camera, source_ns in ((7, 5), (7, 6), (8, 0), (8, 0), (8, 0)):
            events.heard(Place("new", camera, camera, 3, 1), source_ns)
        assert worker.counters[_STOOD_STILL] == 2


@pytest.mark.parametrize("has_holes", [True, False])
def test_a_camera_lost_because_of_holes_in_its_depth_is_told_so(
    make_run: Callable[..., RunInfo], capfd, has_holes: bool
):
    run, depth = make_run(), _frames_of(160, 1)[0].depth_raw.copy()
    if has_holes:
        depth[::3] = 0
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        events = TrackingEvents(worker, SharedMap(worker.arena, worker.options.slam))
        result = TrackResult(
            frame_index=0,
            status="lost",
            T_world_cam=np.eye(4),
            keyframe=-1,
            T_keyframe_cam=np.eye(4),
        )
        events.take(result, depth)
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "lost at frame 0" in line]
    assert (
        "67 % of its pixels have depth, but only 0 % have depth around them" in line
    ) == has_holes


def _frames_of(width_px: int, count: int) -> list[Frame]:
    size = SynthOptions(width_px=width_px, height_px=3 * width_px // 4)
    frames = open_source("synth:room", SourceOptions(frames=count, synth=size)).frames()
    return [item for item in frames if isinstance(item, Frame)]
