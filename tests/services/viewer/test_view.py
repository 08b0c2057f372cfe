"""What run.rrd shows of a run."""

import contextlib
import os
import re

import msgspec
import numpy as np
import rerun as rr

from hsslam_services.viewer import drawing
from hsslam_services.viewer.drawing import Drawing, Intervals
from hsslam_services.viewer.earlier_run import EarlierRun
from hsslam_services.viewer.scene import RerunScene
from hsslam_services.viewer.view import RerunView
from tests.services.recorded import rrd, rrd_rows
from tests.services.viewer.shown_run import show_a_run
from tests.services.wire_samples import blocks, frame, keyframe, mesh, pose
from tests.until import until


def test_the_file_has_the_whole_scene(tmp_path):
    events = []
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *event: events.append(event))
    show_a_run(view)
    view.close()
    assert events == []
    assert view.dropped == 0
    rrd("verify", tmp_path / "run.rrd")
    printed = rrd("print", "-vv", tmp_path / "run.rrd")
    for entity in (
        "/world",
        "/world/camera",
        "/world/camera/image",
        "/world/trajectory/0",
        "/world/trajectory/1",
        "/world/keyframes/0",
        "/world/lost/here",
        "/world/lost/0",
        "/world/loops",
        "/world/mesh",
        "/model",
        "/plots/latency_ms",
        "/plots/fps",
        "/plots/quality",
        "/plots/loss",
        "/plots/memory_mb/mapper",
        "/events",
    ):
        assert f"{entity} " in printed or f"{entity}\n" in printed or f"{entity}`" in printed
    assert "Mesh3D:vertex_colors" in printed
    assert rrd_rows(tmp_path / "run.rrd", "/plots/quality") == 1 + 100  # its style, every pose
    assert rrd_rows(tmp_path / "run.rrd", "/world/camera") == 99  # one pose is lost


def test_a_message_that_cannot_be_drawn_costs_no_other(tmp_path):
    events = []
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *event: events.append(event))
    for index in range(3):
        broken = {"color_encoding": "png", "color": memoryview(b"no image")}
        view.show(msgspec.structs.replace(frame(index), stamp_ns=10**9 * index, **broken))
    view.show(pose(3))
    view.close()
    (event,) = events
    assert event[0] == "warning"
    assert event[1].startswith("rerun: a Frame message is not drawn: ")
    assert rrd_rows(tmp_path / "run.rrd", "/world/camera") == 1


def test_keyframes_of_long_ago_are_not_drawn_any_more(tmp_path):
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *_: None)
    view.show(frame(0))
    for block in range(70):
        view.show(msgspec.structs.replace(keyframe(0), id=32 * block))
    view.close()
    printed = rrd("print", "-vvv", tmp_path / "run.rrd")
    assert printed.count("Clear:is_recursive") >= 70 - 64


def test_a_new_map_epoch_clears_what_was_drawn_of_the_old(tmp_path):
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *_: None)
    show_a_run(view)
    view.show(msgspec.structs.replace(pose(101), map_epoch=1))
    view.show(pose(102))  # a straggler of the old map epoch is not drawn
    view.show(msgspec.structs.replace(pose(103), map_epoch=1))
    view.close()
    printed = rrd("print", "-vvv", tmp_path / "run.rrd")
    assert printed.count("Clear:is_recursive") >= 6
    rows = re.findall(r"with (\d+) rows .* - /world/trajectory/0 ", printed)
    assert sum(map(int, rows)) == 2  # the old path, and from pose 101 to pose 103


def test_blocks_of_a_new_map_stay_if_they_overtake_its_first_message(tmp_path):
    stream = rr.RecordingStream("hsslam", recording_id="run-1")
    stream.set_sinks(rr.FileSink(tmp_path / "run.rrd"))
    scene = RerunScene(stream, poses_every_s=0.0)
    for map_epoch in (0, 1):  # as by a viewer that lags
        scene.add_blocks(msgspec.structs.replace(blocks(1, map_epoch), map_epoch=map_epoch))
        scene.draw(pose(1))
    scene.draw(msgspec.structs.replace(pose(2), map_epoch=1))
    scene.finish()
    stream.disconnect()
    drawn = {
        entity: max(re.findall("row_([0-9A-Fa-f]+)", chunk))
        for entity, chunk in re.findall(
            r" - (/world/mesh\S*) (.*?)(?=\n\n|\Z)",
            rrd("print", "-vvv", tmp_path / "run.rrd"),
            re.S,
        )
    }
    assert drawn["/world/mesh/live/0_0_2"] < drawn["/world/mesh"] < drawn["/world/mesh/live/1_0_2"]


def test_the_next_file_opens_alone(tmp_path):
    first, second = tmp_path / "run.rrd", tmp_path / "run.1.rrd"
    view = RerunView(first, "none", "run-1", lambda *_: None)
    show_a_run(view)
    view.write_to(second)
    view.write_to(second)
    view.show(frame(1))
    view.show(mesh(), in_file=False)
    view.close()
    for path in (first, second):
        rrd("verify", path)
    printed = rrd("print", "-vvv", second)
    for name in (
        "ViewCoordinates:xyz",
        "Pinhole:image_from_camera",
        "EncodedImage:blob",
        "SeriesLines:names",
    ):
        assert name in printed
    for entity in (
        *("world/camera", "world/trajectory/0", "world/trajectory/1", "world/keyframes/0"),
        "world/loops",
    ):
        assert rrd_rows(second, f"/{entity}") == 1
    assert "/world/mesh" not in printed
    assert rrd_rows(first, "/plots/quality") == 1 + 100
    assert rrd_rows(second, "/plots/quality") == 1


def test_what_was_drawn_once_is_drawn_again_for_a_page_that_comes_late(tmp_path):
    path = tmp_path / "run.rrd"
    always = Intervals(images_s=0.0, meshes_s=0.0, poses_s=0.0, flush_s=10.0, again_s=0.0)
    drawing = Drawing(rr.FileSink(path), "run-1", always, lambda *_: None)
    for message in (
        frame(0, compressed=True),
        keyframe(0),
        pose(0),
        pose(1),
        frame(1, compressed=True),
    ):
        drawing.put(message)
    drawing.stop()
    drawing.join()
    assert rrd_rows(path, "/world/keyframes/0") > 1
    assert rrd_rows(path, "/world/trajectory/0") > 1


def test_a_file_that_cannot_be_written_is_reported_and_the_file_before_goes_on(tmp_path):
    events = []
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *event: events.append(event))
    view.write_to(tmp_path / "gone" / "run.1.rrd")
    show_a_run(view)
    view.close()
    [(level, text)] = events
    assert level == "warning" and "run.1.rrd: " in text
    rrd("verify", tmp_path / "run.rrd")
    assert rrd_rows(tmp_path / "run.rrd", "/plots/quality") == 1 + 100


def test_without_a_first_file_the_recording_begins_with_the_next_one(tmp_path):
    """As on a disk that is full at the start of a recorder: the log goes on, so this must not end it."""
    events = []
    view = RerunView(
        tmp_path / "gone" / "run.rrd", "none", "run-1", lambda *event: events.append(event)
    )
    [(level, text)] = events
    assert level == "warning" and text.endswith("no recording until the next part of the log")
    view.show(frame(0))
    assert view.dropped == 1
    view.write_to(tmp_path / "run.1.rrd")
    view.show(frame(1))
    view.close()
    rrd("verify", tmp_path / "run.1.rrd")
    assert "EncodedImage:blob" in rrd("print", "-vvv", tmp_path / "run.1.rrd")
    assert len(events) == 1


def test_a_file_that_takes_too_long_at_the_end_is_reported(tmp_path, monkeypatch):
    """Its disk hangs: nothing reads this pipe."""
    monkeypatch.setattr(drawing, "_FILE_FLUSH_S", 0.0)
    os.mkfifo(tmp_path / "run.rrd")
    pipe = os.open(tmp_path / "run.rrd", os.O_RDONLY | os.O_NONBLOCK)
    events = []
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *event: events.append(event))
    noise = memoryview(np.random.default_rng(0).bytes(1 << 21))  # more than a pipe holds
    view.show(msgspec.structs.replace(frame(0, compressed=True), color=noise))
    (drawing_thread,) = view._threads
    drawing_thread.stop()
    until(lambda: events)
    [(level, text)] = events
    assert level == "warning" and text.endswith("the recording lacks its last data")
    while drawing_thread.is_alive():  # the disk goes on
        with contextlib.suppress(BlockingIOError):
            os.read(pipe, 1 << 20)
    os.close(pipe)


def test_messages_that_are_dropped_take_no_mark_of_a_new_file_and_not_the_run_so_far(tmp_path):
    placed = [(5000, ((7.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))]
    earlier = EarlierRun(map_epoch=0, index=0, stamp_ns=1, keyframes=placed, lines=[])
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *_: None)
    (thread,) = view._threads
    with thread._arrival:  # it draws nothing meanwhile
        view.begin_with(earlier)
        view.write_to(tmp_path / "run.1.rrd")
        for _ in range(5000):
            view.show(pose(0))
        view.show(frame(0))  # keyframes are drawn as large as its camera sees
    view.close()
    assert view.dropped > 0
    rrd("verify", tmp_path / "run.1.rrd")
    assert rrd_rows(tmp_path / "run.1.rrd", "/world/keyframes/156") == 1


def test_show_does_not_wait_for_the_drawing(tmp_path):
    view = RerunView(tmp_path / "run.rrd", "none", "run-1", lambda *_: None)
    large = frame(0, compressed=False, width_px=1920, height_px=1080)
    shown = 0
    while not view.dropped:  # only a queue that is filled faster than it is drawn drops
        view.show(msgspec.structs.replace(large, index=shown, stamp_ns=shown * 10**9))
        shown += 1
        assert shown < 10_000
    view.close()
