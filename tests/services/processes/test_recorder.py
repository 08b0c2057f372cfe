import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rerun_cli
from mcap.reader import make_reader

from hsslam_proto import run_messages, topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_services.artefacts.lost_results import unfinished_log
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.publisher import Publisher
from hsslam_services.log.parted_log import LogSettings
from hsslam_services.processes.recorder import Recorder
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.process_result import ProcessResult, read_result, write_result
from hsslam_services.run.stop_signals import END_SIGNAL
from tests.services.recorded import read_log
from tests.services.wire_samples import frame, keyframe, mesh, pose


def test_in_lockstep_each_frame_that_is_logged_or_refused_has_a_step(endpoint, tmp_path):
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        steps = outside.subscribe(topics.STEP, 64)
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None, is_lockstep=True)
        frames = outside.publisher(topics.FRAME, block=True)
        _wait_for_subscriber(frames)
        no_image = msgspec.structs.replace(frame(1), color_encoding="jpeg", color=b"no image")
        for sent in (frame(0), no_image, frame(2)):
            frames.put(sent)
            _spin(recorder, 0.3)
        recorder.close()
        told = [(step.stage, step.index) for step in steps.drain()]
    assert told == [("logged", 0), ("logged", 1), ("logged", 2)]


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC])
def test_a_log_that_the_disk_did_not_take_is_not_complete(number, endpoint, tmp_path, monkeypatch):
    """The kernel forgets what it could not write; a later sync succeeds without it."""
    to_disk, failures = os.fdatasync, [OSError(number, os.strerror(number))]

    def fail_once(fd: int) -> None:
        if failures:
            raise failures.pop()
        to_disk(fd)

    monkeypatch.setattr(os, "fdatasync", fail_once)
    with Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(
            bus, tmp_path, "run-1", "none", lambda *_: None, LogSettings(part_bytes=1)
        )
        told = recorder.close()
    assert not failures
    assert (told["complete"], told["sync_error"]) == (False, os.strerror(number))
    write_result(tmp_path, "recorder", ProcessResult(summary={"log": told}))
    why = unfinished_log(tmp_path)
    assert why.startswith(f"the disk could not be written ({os.strerror(number)})")


def test_frames_of_others_than_the_runs_camera_are_neither_logged_nor_told(endpoint, tmp_path):
    camera = CameraProgress()
    camera.write(tmp_path)
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        steps = outside.subscribe(topics.STEP, 64)
        recorder = Recorder(
            bus,
            tmp_path,
            "run-1",
            "none",
            lambda *_: None,
            is_lockstep=True,
            camera_arena=tmp_path,
        )
        frames = outside.publisher(topics.FRAME, block=True)
        _wait_for_subscriber(frames)
        for index, publisher in enumerate((camera.publisher, 7, camera.publisher)):
            frames.put(msgspec.structs.replace(frame(index), publisher=publisher))
        _spin(recorder, 0.3)
        recorder.close()
        (rejected,) = (s.rejected for s in bus.subscriptions if s.topic is topics.FRAME)
        told = [step.index for step in steps.drain()]
    logged = [message.index for message in read_log(tmp_path / "run.mcap")["in/frame"]]
    assert (logged, told, rejected) == ([0, 2], [0, 2], 1)


def test_once_the_source_has_ended_the_newest_frame_in_the_log_is_named(endpoint, tmp_path):
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        steps = outside.subscribe(topics.STEP, 64)
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None)
        frames, ends = (
            outside.publisher(topics.FRAME, block=True),
            outside.publisher(topics.SOURCE_END),
        )
        _wait_for_subscriber(frames)
        for sent in (frame(0), frame(1)):
            frames.put(sent)
            _spin(recorder, 0.3)
        assert not steps.drain()
        ends.put(run_messages.SourceEnd(frame_count=3, reason="end of source"))
        _spin(recorder, 0.3)
        frames.put(frame(2))  # on its way when the source ended
        _spin(recorder, 0.3)
        recorder.close()
        told = [(step.stage, step.index) for step in steps.drain()]
    assert told == [("logged", 1), ("logged", 2)]


def test_a_camera_that_goes_on_sending_does_not_hold_up_the_end(endpoint, tmp_path):
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None)
        frames, is_over = outside.publisher(topics.FRAME, block=True), threading.Event()
        _wait_for_subscriber(frames)

        def send() -> None:
            index = 0
            while not is_over.wait(0.05):
                frames.put(frame(index))
                index += 1

        camera = threading.Thread(target=send)
        camera.start()
        _spin(recorder, 0.3)
        begin_s = time.monotonic()
        summary = recorder.close()
        took_s = time.monotonic() - begin_s
        is_over.set()
        camera.join()
    assert took_s < 10
    assert summary["complete"] is True
    assert 0 < summary["frames_logged"] == len(read_log(tmp_path / "run.mcap")["in/frame"])


def test_a_run_is_logged_whole(endpoint, tmp_path):
    events = []
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        early = outside.publisher(topics.POSE)
        early.put(pose(0))
        early_keyframe = outside.publisher(topics.KEYFRAME)
        early_keyframe.put(keyframe(0))
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *e: events.append(e))
        frames, meshes = outside.publisher(topics.FRAME, block=True), outside.publisher(topics.MESH)
        sent = [frame(index) for index in range(30)]
        _spin(recorder, 0.3)
        for index in range(1, 30):
            frames.put(sent[index])
            early.put(pose(index))
            recorder.spin_once(0.01)
        early_keyframe.put(keyframe(1))
        meshes.put(mesh(final=True))
        outside.publisher(topics.SOURCE_END).put(run_messages.SourceEnd(frame_count=30))
        summary = recorder.close()
    read = read_log(tmp_path / "run.mcap")
    assert [m.index for m in read["out/pose"]] == list(range(30))
    assert [m.index for m in read["in/frame"]] == list(range(1, 30))
    assert [m.id for m in read["out/keyframe"]] == [0, 1]
    assert len(read["out/mesh"]) == len(read["in/end"]) == 1
    logged = read["in/frame"][4]
    assert (logged.color_encoding, logged.depth_encoding) == ("jpeg", "png")
    back, original = frame_from_message(logged), frame_from_message(sent[5])
    np.testing.assert_array_equal(back.depth_raw, original.depth_raw)
    assert np.abs(back.color.astype(int) - original.color).mean() < 4
    assert summary["frames_logged"] == 29
    assert summary["poses_logged"] == 30
    assert summary["frames_dropped"] == summary["poses_dropped"] == 0
    assert summary["complete"] is True
    assert summary["parts"] == ["run.mcap"]
    assert (tmp_path / "run.rrd").stat().st_size > 1000
    assert events == []


def test_the_process_ends_in_order_when_it_is_told_to(run_info):
    command = [
        sys.executable,
        "-m",
        "hsslam_services.processes.recorder",
        "--run",
        run_info.run_dir,
    ]
    recorder = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    with Bus(run_info.endpoint, run_info.robot, "tracker") as bus:
        health, poses = bus.subscribe(topics.HEALTH, depth=64), bus.publisher(topics.POSE)
        while (beat := health.wait(20.0)) is None or beat.state != "running":
            assert recorder.poll() is None, recorder.communicate()
        for index in range(10):
            poses.put(pose(index))
        recorder.send_signal(END_SIGNAL)
        assert recorder.wait(timeout=20) == 0, recorder.communicate()
        beats = health.drain()
    assert beats[-1].counters["poses_logged"] == 10
    assert (run_info.path / "run.rrd").exists()
    assert read_result(run_info.path, "recorder").summary["log"]["poses_logged"] == 10


def test_rerun_reads_the_log(endpoint, tmp_path):
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None)
        frames, poses = outside.publisher(topics.FRAME, block=True), outside.publisher(topics.POSE)
        _spin(recorder, 0.3)
        frames.put(frame(0))
        poses.put(pose(0))
        recorder.close()
    rerun = str(Path(rerun_cli.__file__).parent / "rerun")
    converted = tmp_path / "converted.rrd"
    convert = [rerun, "mcap", "convert", str(tmp_path / "run.mcap"), "-o", str(converted)]
    subprocess.run(convert, check=True, capture_output=True)
    printed = subprocess.run(
        [rerun, "rrd", "print", "-vv", converted], check=True, capture_output=True, text=True
    ).stdout
    assert "/viz/camera/image" in printed


def test_a_nearly_full_disk_stops_large_things_until_there_is_room(endpoint, disk, monkeypatch):
    monkeypatch.setattr("hsslam_services.log.mcap_writer.RESERVE_BYTES", 40 * 2**20)
    folder = disk.folder / "run"
    folder.mkdir()
    ballast = disk.folder / "ballast"
    events = []
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, folder, "run-1", "none", lambda *e: events.append(e))
        frames, poses = outside.publisher(topics.FRAME, block=True), outside.publisher(topics.POSE)

        def send(first):
            for index in range(first, first + 10):
                frames.put(frame(index))
                poses.put(pose(index))
                _spin(recorder, 0.15)

        _spin(recorder, 0.3)
        send(0)
        ballast.write_bytes(bytes(45 * 2**20))
        _spin(recorder, 1.5)
        recorder._view._threads[0]._stream.flush()
        rrd_bytes = (folder / "run.rrd").stat().st_size
        send(10)
        recorder._view._threads[0]._stream.flush()
        assert (folder / "run.rrd").stat().st_size == rrd_bytes
        ballast.unlink()
        _spin(recorder, 1.5)
        send(20)
        summary = recorder.close()
    assert [level for level, _ in events] == ["warning", "info", "warning"]
    assert "run.rrd" in events[0][1]
    assert events[2][1].endswith("10 frames are not recorded: the disk was nearly full")
    assert (folder / "run.rrd").stat().st_size > rrd_bytes
    read = read_log(folder / "run.mcap")
    assert [m.index for m in read["out/pose"]] == list(range(30))
    assert [m.index for m in read["in/frame"]] == [*range(10), *range(20, 30)]
    assert (summary["frames_dropped"], summary["complete"]) == (10, True)


def test_short_space_stops_frames_but_not_poses(endpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("hsslam_services.log.mcap_writer.RESERVE_BYTES", 2**62)
    events = []
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *e: events.append(e))
        frames, poses = outside.publisher(topics.FRAME, block=True), outside.publisher(topics.POSE)
        _spin(recorder, 0.3)
        for index in range(5):
            frames.put(frame(index))
            poses.put(pose(index))
        summary = recorder.close()
    read = read_log(tmp_path / "run.mcap")
    assert len(read["out/pose"]) == 5
    assert "in/frame" not in read
    assert len(events) == 2 and "disk nearly full" in events[0][1]
    assert events[1][1].endswith("5 frames are not recorded: the disk was nearly full")
    assert summary["frames_dropped"] == 5


def test_each_part_of_the_log_has_a_file_for_rerun(endpoint, tmp_path):
    settings = LogSettings(part_bytes=5_000)
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None, settings)
        frames, poses = outside.publisher(topics.FRAME, block=True), outside.publisher(topics.POSE)
        _spin(recorder, 0.3)
        for index in range(40):
            frames.put(frame(index))
            poses.put(pose(index))
            _spin(recorder, 0.06)
        parts = recorder.close()["parts"]
    assert len(parts) > 2
    recordings = [(tmp_path / part).with_suffix(".rrd") for part in parts]
    rerun = str(Path(rerun_cli.__file__).parent / "rerun")
    subprocess.run([rerun, "rrd", "verify", *recordings], check=True, capture_output=True)
    for part in parts:
        with (tmp_path / part).open("rb") as stream:
            topics_of_part = {c.topic for _, c, _ in make_reader(stream).iter_messages()}
        has_image = "/viz/camera/image" in topics_of_part
        assert has_image == ("/viz/camera/calibration" in topics_of_part), part


def test_compressed_frames_are_logged_as_they_came(endpoint, tmp_path):
    sent = frame(0, compressed=True)
    with Bus(endpoint, "r", "camera") as outside, Bus(endpoint, "r", "recorder") as bus:
        recorder = Recorder(bus, tmp_path, "run-1", "none", lambda *_: None)
        frames = outside.publisher(topics.FRAME, block=True)
        _spin(recorder, 0.3)
        frames.put(sent)
        recorder.close()
    (logged,) = read_log(tmp_path / "run.mcap")["in/frame"]
    assert bytes(logged.color) == bytes(sent.color)
    assert bytes(logged.depth) == bytes(sent.depth)


def _wait_for_subscriber(publisher: Publisher) -> None:
    """Return when the router knows of one: what is sent before is lost."""
    deadline = time.monotonic() + 30
    while not publisher.has_subscribers():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _spin(recorder, seconds) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        recorder.spin_once(0.05)
