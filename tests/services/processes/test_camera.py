"""The camera process on a real bus: who waits for whom, resends, restarts, how it ends."""

import contextlib
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.files import image_files
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.messages import MapVersion
from hsslam_proto.run_messages import Step
from hsslam_services.launch.worker import Worker
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.processes import camera
from hsslam_services.run.camera_progress import UNREAD, CameraProgress
from tests.sequence_folders import write_tum_camera
from tests.services.processes.other_end import OtherEnd
from tests.services.wire_samples import frame as sample_frame


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


def test_a_frame_that_a_failing_disk_does_not_give_is_counted_by_itself(
    other_end, tum_folder: Path
):
    image = tum_folder / "rgb/2.png"
    image.unlink()
    image.symlink_to("/proc/self/mem")  # its first byte is an input/output error
    end = other_end(source=f"tum:{tum_folder}", pace="lockstep")
    events = end.bus.subscribe(topics.EVENT, 16)
    for index in (0, 1, 3, 4):
        frame = end.next_frame()
        assert frame.index == index
        end.done(frame)
    source_end = end.end.wait(5)
    assert (source_end.frame_count, source_end.bad_frame_count) == (4, 1)
    told = f"frame 2 skipped: {image}: Input/output error"
    assert told in [event.text for event in events.drain()]
    assert end.counter(UNREAD) == 1


def test_a_disk_that_gives_no_frame_any_more_ends_the_camera(
    make_run, tum_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(image_files, "_WAITS_S", ())
    for number in range(1, 5):
        image = tum_folder / f"depth/{number}.png"
        image.unlink()
        image.symlink_to("/proc/self/mem")
    run = make_run(source=f"tum:{tum_folder}", pace="lockstep")
    end = OtherEnd(run, starts_camera=False)
    with (
        contextlib.closing(end.bus),
        Worker("camera", replace(run, supervisor_pid=os.getppid())) as worker,
        ThreadPoolExecutor(1) as pool,
    ):
        running = pool.submit(camera._run, worker)
        end.done(end.next_frame())
        told = r"4 frames in a row cannot be read, the last: .*4\.png: Input/output error$"
        with pytest.raises(UserError, match=told):
            running.result(30)


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
