"""A log as a source: the frames that were logged, with their stamps and indices."""

from itertools import groupby

import cv2
import msgspec
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.frame_order import new_publisher
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.reading.source import recorded_source, repeated_effects, run_metadata
from hsslam_services.run.options import ServeOptions
from hsslam_services.supervisor.preparation import prepare
from tests.late_frames import expect_late_frames_left_out
from tests.services.log.sample_log import write_log
from tests.services.wire_samples import frame


def test_a_lossless_log_gives_the_frames_bit_for_bit(tmp_path):
    camera = new_publisher()
    indices = (0, 1, 2, 2, 4, 5)  # 2 was sent again, 3 was bad
    sent = [msgspec.structs.replace(frame(index), publisher=camera) for index in indices]
    _write(tmp_path, sent, "png")
    source = open_any_source(f"mcap:{tmp_path / 'run.mcap'}")
    found = [item for item in source.frames() if isinstance(item, Frame)]
    assert [item.index for item in found] == [0, 1, 2, 4, 5]
    for item, message in zip(found, [sent[k] for k in (0, 1, 2, 4, 5)], strict=True):
        expected = frame_from_message(message)
        np.testing.assert_array_equal(item.color, expected.color)
        np.testing.assert_array_equal(item.depth_raw, expected.depth_raw)
        assert (item.stamp_ns, item.camera) == (expected.stamp_ns, expected.camera)
        assert item.depth_units_per_m == expected.depth_units_per_m
    assert source.rate_hz == pytest.approx(30, rel=1e-3)
    assert source.camera == found[0].camera


def test_the_frames_of_a_camera_that_began_anew_go_on_behind_the_last(tmp_path):
    cameras = (new_publisher(), new_publisher())
    sent = [msgspec.structs.replace(frame(i), publisher=c) for c in cameras for i in range(3)]
    sent += [frame(k) for k in (0, 1, 0, 1)]
    wheels = {"odometry": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "odometry_series": 5}
    _write(tmp_path, [msgspec.structs.replace(message, **wheels) for message in sent], "png")
    found = list(open_any_source(f"mcap:{tmp_path / 'run.mcap'}").frames())
    assert [item.index for item in found] == list(range(10))
    series = [f.odometry.series for f in found if isinstance(f, Frame) and f.odometry is not None]
    assert [len(list(same)) for _, same in groupby(series)] == [3, 3, 2, 2]


def test_a_first_frame_without_a_valid_camera_is_skipped_as_in_the_live_run(tmp_path):
    sent = [msgspec.structs.replace(frame(0), fx=2e6), frame(1), frame(2)]
    _write(tmp_path, sent, "png")
    source = open_any_source(f"mcap:{tmp_path}")
    items = list(source.frames())
    assert isinstance(items[0], BadFrame) and "camera.fx = 2000000.0" in items[0].reason
    assert [item.index for item in items[1:] if isinstance(item, Frame)] == [1, 2]
    assert source.camera == frame_from_message(sent[1]).camera
    (tmp_path / "none").mkdir()
    _write(tmp_path / "none", sent[:1], "png")
    with pytest.raises(UserError, match=r"source mcap:.*none: camera.fx = 2000000.0: expected"):
        open_any_source(f"mcap:{tmp_path / 'none'}")


def test_frames_of_another_camera_than_the_first_are_bad_ones(tmp_path):
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((48, 64), 255, np.uint8))
    sent = [frame(0), frame(1), frame(2, width_px=32, height_px=24), frame(3), frame(4)]
    sent[1] = msgspec.structs.replace(sent[1], fx=80.0)  # another lens
    sent[3] = msgspec.structs.replace(sent[3], depth_units_per_m=1000.0)
    _write(tmp_path, sent, "png")
    mask = SourceOptions(mask=str(tmp_path / "mask.png"))
    for options in (SourceOptions(), SourceOptions(downscale=2), mask):
        found = list(open_any_source(f"mcap:{tmp_path}", options).frames())
        assert [item.index for item in found] == [0, 1, 2, 3, 4]
        assert isinstance(found[0], Frame) and isinstance(found[4], Frame)
        assert [item.reason for item in found[1:4] if isinstance(item, BadFrame)] == [
            "camera.fx 80.00: expected 51.20 as in the first frame",
            "size 32 x 24 px: expected 64 x 48 px as in the first frame",
            "depth_units_per_m 1000.0: expected 5000.0 as in the first frame",
        ]
    later = open_any_source(f"mcap:{tmp_path}", SourceOptions(start=2))
    assert later.camera.width_px == 32
    assert [isinstance(item, Frame) for item in later.frames()] == [True, False, False]


def test_a_jpeg_log_differs_in_colour_only(tmp_path):
    sent = frame(3)
    _write(tmp_path, [sent], "jpeg")
    (found,) = open_any_source(f"mcap:{tmp_path}").frames()
    assert isinstance(found, Frame)
    expected = frame_from_message(sent)
    np.testing.assert_array_equal(found.depth_raw, expected.depth_raw)
    difference = np.abs(found.color.astype(int) - expected.color)
    assert 0 < difference.max() < 30


def test_frames_are_selected_as_of_any_source_and_taken_from_all_parts(tmp_path):
    _write(tmp_path, [frame(index) for index in range(20)], "png", part_bytes=2000)
    assert (tmp_path / "run.2.mcap").exists()
    options = SourceOptions(stride=3, frames=4, downscale=2)
    found = list(open_any_source(f"mcap:{tmp_path}", options).frames())
    assert [item.index for item in found] == [0, 3, 6, 9]
    later = open_any_source(f"mcap:{tmp_path}", SourceOptions(start=5, stride=3, frames=3))
    assert [item.index for item in later.frames()] == [5, 8, 11]
    assert isinstance(found[0], Frame) and found[0].color.shape == (24, 32, 3)
    assert later.frame_count == 3
    with pytest.raises(UserError, match=r"mcap:.* has 20 frames"):
        open_any_source(f"mcap:{tmp_path}", SourceOptions(start=20))


def test_a_log_without_frames_is_one_line(tmp_path):
    _write(tmp_path, [], "png")
    with pytest.raises(UserError, match="holds no frames"):
        open_any_source(f"mcap:{tmp_path}")


@pytest.mark.parametrize(
    ("logged", "options", "expected"),
    [
        (range(20, 40), SourceOptions(), (2 + 3 * 20, 3, 20)),  # begins later
        ((0, 1, 4, 9, 11), SourceOptions(), (2, 3, 12)),  # has gaps
        ((0, 1, 4, 9, 11), SourceOptions(start=1, stride=2), (2 + 3, 3 * 8, 2)),
        (range(9, 50, 5), SourceOptions(start=1, stride=2), (2 + 3 * 14, 3 * 10, 4)),  # strides
        ((7,), SourceOptions(), (2 + 3 * 7, 3, 1)),
    ],
)
def test_what_a_log_was_recorded_from_is_found_by_the_indices_of_its_frames(
    tmp_path, logged, options, expected
):
    run = ServeOptions(source="synth:room", start=2, stride=3, frames=100)
    whole, short = tmp_path / "whole", tmp_path / "short"
    for folder in (whole, short):
        folder.mkdir()
    _write(whole, [frame(k) for k in (*range(5), *range(7, 50))], "png", run=run)
    # the second log records a replay of the first: both number their frames alike
    again = ServeOptions(source=f"mcap:{whole}", start=1)
    _write(short, [frame(k) for k in logged], "png", run=again)
    found = recorded_source(f"mcap:{short}", options, print)
    assert found.spec == "synth:room"
    assert (found.options.start, found.options.stride) == expected[:2]
    assert found.options.frames == expected[2]


def test_a_stride_over_the_frames_of_a_log_is_one_over_what_it_was_recorded_from(tmp_path):
    run = ServeOptions(source="synth:room", start=2, stride=3)
    _write(tmp_path, [frame(k) for k in range(5, 20)], "png", run=run)
    found = recorded_source(f"mcap:{tmp_path}", SourceOptions(stride=4), print).options
    assert (found.start, found.stride, found.frames) == (2 + 3 * 5, 3 * 4, 4)


def test_the_indices_of_two_cameras_tell_nothing_of_what_was_recorded(tmp_path):
    run = ServeOptions(source="synth:room", frames=100)
    cameras = (new_publisher(), new_publisher())
    sent = [msgspec.structs.replace(frame(k), publisher=c) for c in cameras for k in (5, 6)]
    _write(tmp_path, sent, "png", run=run)
    assert recorded_source(f"mcap:{tmp_path}", SourceOptions(), print).options == run.source_options


def test_an_effect_that_the_logged_frames_have_already_is_told(tmp_path):
    run = ServeOptions(noise="kinect", downscale=2, cover_frames=3)
    _write(tmp_path, [frame(0)], "png", run=run)
    source, out = f"mcap:{tmp_path}", str(tmp_path / "again")
    again = ServeOptions(source=source, out=out, noise="kinect", exposure="drift", cover_frames=3)
    told = f"--noise kinect: the frames of {source} already have --noise kinect, and get it again"
    assert repeated_effects(again) == [told]
    prepared = prepare(again, lambda: False)
    prepared.close()
    prepared.arena.remove()
    assert (told, "warning") in prepared.notices
    assert repeated_effects(ServeOptions(source=source)) == []
    assert repeated_effects(ServeOptions(noise="kinect")) == []


def _write(folder, frames, color, part_bytes=None, run=None):
    metadata = {"options": msgspec.json.encode(run).decode()} if run else {}
    log = PartedLog(folder, "r", LogSettings(color, part_bytes, metadata=metadata))
    for sequence, message in enumerate(frames):
        payload = encode(topics.FRAME, compress_frame(message, color))
        log.write(topics.FRAME, payload, message.stamp_ns, message.stamp_ns, sequence)
        log._part._writer.flush()
    log.close()


def test_images_of_late_frames_are_not_decoded(tmp_path):
    _write(tmp_path, [frame(index) for index in range(8)], "png")
    options = SourceOptions(start=1, stride=2)
    expect_late_frames_left_out(open_any_source(f"mcap:{tmp_path}", options))


def test_metadata_that_the_first_part_has_lost_are_those_of_the_next(tmp_path):
    lost, kept = (tmp_path / name / "run.mcap" for name in ("lost", "kept"))
    lost.parent.mkdir()
    write_log(lost.parent, count=1)
    assert run_metadata([lost]) == {}
    kept.parent.mkdir()
    write_log(kept.parent, count=1, metadata={"run_id": "x"})
    assert run_metadata([lost, kept]) == {"run_id": "x"}
