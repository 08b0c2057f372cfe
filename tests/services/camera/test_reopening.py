"""A live camera that goes away for a while is opened again, and goes on where it was."""

import itertools
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import PRESETS
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.options.topics import BagOptions, Ros2Options
from hsslam_node.sources.source import BadFrame, NoFrame, SourceLostError
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.camera import reopening, ros2_source
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.camera.reopening import live_frames, open_with_patience, with_reports
from hsslam_services.launch.worker import Worker
from hsslam_services.run.run_info import RunInfo
from tests.sequence_folders import write_tum_camera
from tests.services.camera.bags.ros_bags import new_bag
from tests.services.camera.ros_camera import RosCamera

_ROOM = SourceOptions(frames=6, synth=SynthOptions(width_px=160, height_px=120))


@pytest.fixture
def room() -> list[Frame]:
    return [
        frame for frame in open_source("synth:room", _ROOM).frames() if isinstance(frame, Frame)
    ]


def test_a_driver_that_is_restarted_with_another_lens_before_there_are_keyframes_goes_on(
    make_run: Callable[..., RunInfo], endpoint: str, room: list[Frame], monkeypatch
):
    monkeypatch.setattr(ros2_source, "_SILENCE_S", 0.5)
    ros2 = Ros2Options(connect=endpoint, timeout_s=5.0)
    run = make_run(source="ros2:/camera", ros2=ros2, start=3, frames=20)
    first = RosCamera(endpoint)
    first.start(room)
    second = RosCamera(endpoint)
    taken: list[Frame | BadFrame] = []
    try:
        with Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker:
            source = open_with_patience(worker, had_frames=False)
            assert source is not None
            frames = live_frames(worker, source, 0)
            taken += itertools.islice(frames, 5)
            first.close()
            silences = 0
            for item in frames:
                taken.append(item)
                silences += isinstance(item, NoFrame)
                if silences == 3 and isinstance(
                    item, NoFrame
                ):  # the source is lost, and opened again
                    second.start(room, camera=replace(room[0].camera, fx=99.0))
            assert worker.counters["reopened"] == 1
    finally:
        first.close()
        second.close()
    counted = [item.index for item in taken if not isinstance(item, NoFrame)]
    assert counted == list(range(20))  # `--frames`, and `--start` once
    good = [item for item in taken if isinstance(item, Frame)]
    assert good[0].camera.fx != 99.0 and good[-1].camera.fx == 99.0
    lost = [item.reason for item in taken if isinstance(item, NoFrame)]
    assert len(lost) >= 3 and all(reason.startswith("no frame for 0.5 s: no") for reason in lost)


@pytest.mark.parametrize("first", [0, 3])
def test_a_camera_that_does_not_count_its_frames_ends_after_those_that_are_asked_for(
    make_run: Callable[..., RunInfo], first: int
):
    run = make_run(source="synth:room", frames=4)
    with Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker:
        taken = list(live_frames(worker, open_source("synth:room", _ROOM), first))
    assert [item.index for item in taken] == list(range(first, 4))  # of six


def test_what_a_source_has_to_tell_is_told_once_and_counted(
    make_run: Callable[..., RunInfo], endpoint: str, room: list[Frame], tmp_path: Path
):
    topic = f"/{'r' * 194}/odom"  # 200 characters
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for frame in room:
            bag.odometry(topic, frame.stamp_ns, (0.0,) * 7)
            bag.frame(frame)
    options = SourceOptions(bag=BagOptions(odometry=topic), cover_frames=1)
    source = open_any_source(f"bag:{tmp_path / 'bag'}", options)
    run = replace(make_run(), supervisor_pid=os.getppid())
    with Bus(run.endpoint, run.robot, "test") as bus, Worker("camera", run) as worker:
        events = bus.subscribe(topics.EVENT, 16)
        items = list(with_reports(worker, source, source.frames()))
        assert all(isinstance(item, Frame) for item in items) and len(items) == 6
        assert worker.counters[f"{topic}: unusable messages"] == 6
        event = events.wait(20)
        assert event is not None and event.text.startswith(f"{topic}: odometry: position [")
        assert events.wait(0.2) is None
        beats = bus.subscribe(topics.HEALTH, 1)
        beat = beats.wait(20)  # of those that come every half second
        assert beat is not None and 6 in beat.counters.values() and beats.rejected == 0


def test_a_camera_of_another_lens_than_the_keyframes_is_waited_for(
    make_run: Callable[..., RunInfo], tum_folder: Path, tmp_path: Path, monkeypatch
):
    monkeypatch.setattr("hsslam_services.launch.worker.FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr(reopening, "is_live", lambda _: True)  # a folder is easier to change
    run = replace(make_run(source=f"tum:{tum_folder}"), supervisor_pid=os.getppid())
    with (
        Bus(run.endpoint, run.robot, "test") as bus,
        Worker("camera", run) as worker,
        ThreadPoolExecutor(1) as process,
    ):
        events = bus.subscribe(topics.EVENT, 16)
        before = open_with_patience(worker, had_frames=False)
        assert before is not None
        KeyframeStore.create(worker.arena, before.camera, before.depth_units_per_m, 4)
        write_tum_camera(tum_folder, fx=99.0)
        again = process.submit(open_with_patience, worker, had_frames=True)
        while worker.counters.get("opened in vain", 0) < 2:
            time.sleep(0.01)
        write_tum_camera(tmp_path)
        (tmp_path / "camera.json").replace(tum_folder / "camera.json")
        source = again.result(30)
        assert source is not None and source.camera == before.camera
        told = events.wait(20)
        assert told is not None and told.text == (
            f"source tum:{tum_folder}: camera.fx 99.00: expected 50.00 as in the keyframes: the "
            "camera tries again"
        )
        assert events.wait(0.2) is None


def test_a_camera_of_another_lens_than_the_saved_map_is_refused(
    make_run: Callable[..., RunInfo], tum_folder: Path
):
    run = make_run(source=f"tum:{tum_folder}", map="office", slam=PRESETS["realtime"])
    with Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker:
        lens = replace(open_any_source(run.options.source, SourceOptions()).camera, fx=99.0)
        KeyframeStore.create(worker.arena, lens, 5000.0, 4)  # by the map loader
        told = (
            r"--map office: camera.fx of source tum:.* is 50.00 px: expected 99.00, as in the map"
        )
        with pytest.raises(UserError, match=told):
            open_with_patience(worker, had_frames=False)


def test_a_recording_that_cannot_be_opened_any_more_ends_the_process(
    make_run: Callable[..., RunInfo], tmp_path: Path
):
    """The supervisor restarts it some times, then ends the run with a failure."""
    run = make_run(source=f"tum:{tmp_path / 'unplugged'}")
    with (
        Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker,
        pytest.raises(SourceLostError, match="unplugged"),
    ):
        open_with_patience(worker, had_frames=True)
