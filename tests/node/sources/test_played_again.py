"""Frames that come more than once: to and fro, or held; stamps run on and the truth follows."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.sources.cameras.rows import OAK, ORBBEC
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.registry import SOURCES

_SYNTH = SynthOptions(length=5, width_px=32, height_px=32)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"to_and_fro": 1}, [0, 1, 2, 3, 4]),
        ({"to_and_fro": 2}, [0, 1, 2, 3, 4, 3, 2, 1, 0]),
        ({"to_and_fro": 3}, [0, 1, 2, 3, 4, 3, 2, 1, 0, 1, 2, 3, 4]),
        ({"to_and_fro": 2, "stride": 2}, [0, 2, 4, 2, 0]),
        ({"to_and_fro": 3, "frames": 7}, [0, 1, 2, 3, 4, 3, 2]),
        ({"hold_at": 2, "hold_frames": 3}, [0, 1, 2, 2, 2, 2, 3, 4]),
        ({"to_and_fro": 2, "hold_at": 4, "hold_frames": 1}, [0, 1, 2, 3, 4, 4, 3, 2, 1, 0]),
        ({"hold_at": 9, "hold_frames": 3}, [0, 1, 2, 3, 4]),
    ],
)
def test_the_order(options: dict, expected: list[int]):
    assert list(SourceOptions(**options).selected(5)) == expected


def test_frames_stamps_and_truth_of_a_scene():
    again = SourceOptions(synth=_SYNTH, to_and_fro=2, hold_at=1, hold_frames=2)
    source = open_source("synth:room", again)
    frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    once = [
        f
        for f in open_source("synth:room", SourceOptions(synth=_SYNTH)).frames()
        if isinstance(f, Frame)
    ]
    order = [0, 1, 1, 1, 2, 3, 4, 3, 2, 1, 0]
    assert source.frame_count == len(frames) == len(order)
    assert [frame.index for frame in frames] == list(range(len(order)))
    assert [frame.stamp_ns for frame in frames] == [round(n * 1e9 / 30) for n in range(len(order))]
    for frame, k in zip(frames, order, strict=True):
        np.testing.assert_array_equal(frame.depth_raw, once[k].depth_raw)
    truth, truth_once = (
        open_ground_truth("synth:room", o) for o in (again, SourceOptions(synth=_SYNTH))
    )
    assert truth is not None and truth_once is not None
    assert list(truth.stamps_ns) == [frame.stamp_ns for frame in frames]
    np.testing.assert_array_equal(truth.T_world_cam, truth_once.T_world_cam[order])


def test_noise_differs_from_one_time_to_the_next():
    options = SourceOptions(synth=_SYNTH, noise="kinect", hold_frames=1, frames=2)
    first, second = open_source("synth:room", options).frames()
    assert isinstance(first, Frame) and isinstance(second, Frame)
    assert (first.depth_raw != second.depth_raw).any()


def test_image_files_backwards(replica_folder, tum_folder):
    spec = f"replica:{replica_folder}"
    once = list(open_source(spec).frames())
    options = SourceOptions(to_and_fro=2)
    source = open_source(spec, options)
    frames = list(source.frames())
    assert len(frames) == 2 * len(once) - 1
    assert source.rate_hz == open_source(spec).rate_hz
    assert (np.diff([frame.stamp_ns for frame in frames]) > 0).all()
    assert isinstance(frames[-1], Frame) and isinstance(once[0], Frame)
    np.testing.assert_array_equal(frames[-1].color, once[0].color)
    assert open_source(f"tum:{tum_folder}", options).rate_hz == pytest.approx(
        open_source(f"tum:{tum_folder}").rate_hz
    )


@pytest.mark.parametrize("poses_per_frame", [1, 2])
def test_truth_of_image_files_follows_if_every_frame_has_it(tum_folder, poses_per_frame):
    path, spec = tum_folder / "groundtruth.txt", f"tum:{tum_folder}"
    lines = path.read_text().splitlines()
    more = [f"{float(line.split()[0]) + 0.005} 99 0 0 0 0 0 1" for line in lines[1:]]
    path.write_text("\n".join(lines + more * (poses_per_frame - 1)))
    again = SourceOptions(to_and_fro=2, hold_at=1, hold_frames=2)
    truth = open_ground_truth(spec, again)
    assert truth is not None
    np.testing.assert_array_equal(truth.T_world_cam[:, 0, 3], [0, 1, 1, 1, 2, 3, 4, 3, 2, 1, 0])
    assert list(truth.stamps_ns) == [frame.stamp_ns for frame in open_source(spec, again).frames()]
    path.write_text("\n".join(lines[:-1]))
    assert open_ground_truth(spec) is not None
    assert open_ground_truth(spec, again) is None


def test_an_interrupted_run_has_the_stamps_of_the_whole(tum_folder):
    """At 15 Hz; more than half of the steps are those of the held frame."""
    spec, held = f"tum:{tum_folder}", SourceOptions(stride=2, hold_at=1, hold_frames=9)
    rate_hz = open_source(spec, SourceOptions(stride=2)).rate_hz
    assert rate_hz == pytest.approx(15, rel=1e-3)
    whole = [frame.stamp_ns for frame in open_source(spec, held).frames()]
    for options in (held, replace(held, frames=2), replace(held, frames=7)):
        assert open_source(spec, options).rate_hz == rate_hz
        truth = open_ground_truth(spec, options)
        assert truth is not None and list(truth.stamps_ns) == whole[: options.frames]


@pytest.mark.parametrize("source", ["realsense", "orbbec", "oak:1"])
def test_what_plays_forwards_only_is_refused(source: str):
    with pytest.raises(UserError, match=r"--to-and-fro, --hold-frames: source \S+ plays forwards"):
        open_source(source, SourceOptions(hold_frames=2), rows=(*SOURCES, OAK, ORBBEC))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"to_and_fro": 0}, "to-and-fro 0"),
        ({"hold_at": -1}, "hold-at -1"),
        ({"hold_frames": -1}, "-1"),
    ],
)
def test_absurd_numbers_are_refused(options: dict, expected: str):
    with pytest.raises(UserError, match=expected):
        replace(SourceOptions(), **options)
