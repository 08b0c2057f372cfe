"""The path in the viewer: its colours, its entities, and that it moves with its keyframes."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st

from hsslam_proto.messages import Correction, Pose
from hsslam_services.viewer.path.fragment import FragmentPath
from hsslam_services.viewer.path.line import colored_strips, quality_color
from hsslam_services.viewer.path.rerun_path import RerunPath
from hsslam_services.viewer.scene import RerunScene
from tests.services.recorded import rrd
from tests.services.wire_samples import frame, keyframe, pose

_RED, _BLUE = (255, 0, 0), (0, 0, 255)
_AT_REST = (0.0, 0.0, 0.0, 1.0)
_HALF_TURN = (0.0, 0.0, 1.0, 0.0)  # about z: x becomes -x


def test_colour_says_how_well_the_camera_is_tracked():
    assert quality_color(0.0) == quality_color(0.3) == (255, 110, 40)
    assert quality_color(0.9) == quality_color(1.0) == (70, 200, 255)
    assert quality_color(0.45) == (255, 165, 50)


@pytest.mark.parametrize("quality", [0.0, 0.31, 0.6, 0.75, 1.0])
def test_colours_are_bytes(quality):
    assert all(0 <= value <= 255 for value in quality_color(quality))


@given(st.lists(st.sampled_from([_RED, _BLUE]), min_size=2, max_size=12))
def test_poses_of_one_colour_are_one_strip(colors):
    points = [(float(k), 0.0, 0.0) for k in range(len(colors))]
    strips, strip_colors = colored_strips(points, colors)
    drawn = [
        (segment, color)
        for strip, color in zip(strips, strip_colors, strict=True)
        for segment in pairwise(strip)
    ]
    assert drawn == list(zip(pairwise(points), colors[1:], strict=True))
    assert all(a != b for a, b in pairwise(strip_colors))


def test_a_long_path_is_few_entities_which_all_move_with_their_keyframes(tmp_path):
    with _stream(tmp_path / "path.rrd") as stream:
        path = RerunPath(stream)
        for index in range(64 * 100):
            path.add(_in_keyframe(index, 0))
        path.draw()
        path.correct(_moved(0, (0.0, 0.0, 1.0)))
        path.draw()
    lines = _lines(tmp_path / "path.rrd")
    old = [name for name in lines if name.startswith("trajectory/old/")]
    assert 1 <= len(old) <= 2 and len(lines) <= 68
    assert "Clear" in rrd("print", "-v", tmp_path / "path.rrd")
    assert all((points[:, 2] == 1).all() for points in lines.values())


def test_what_was_tracked_from_a_corrected_keyframe_moves_and_no_more(tmp_path):
    with _stream(tmp_path / "path.rrd") as stream:
        path = RerunPath(stream)
        for index in range(8):
            lost = index == 4
            path.add(pose(index, "lost") if lost else _in_keyframe(index, int(index > 5)))
        path.draw()
        path.correct(_moved(0, (0.0, 1.0, 0.0), _HALF_TURN))
        path.draw()
        path.correct(_moved(1, (0.0, 0.001, 0.0)))  # nobody sees that
        assert all(line.is_drawn for line in path._lines())
    lines = _lines(tmp_path / "path.rrd")
    moved = [[-x, 1, 0] for x in range(6)]
    np.testing.assert_allclose(lines["trajectory/0"], moved[:4], atol=1e-6)
    np.testing.assert_allclose(lines["trajectory/1"], [moved[5], [6, 0, 0], [7, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(lines["lost/0"], [moved[3], moved[5]], atol=1e-6)


def test_a_keyframe_is_drawn_where_a_correction_put_it_that_came_before(tmp_path):
    with _stream(tmp_path / "path.rrd") as stream:
        scene = RerunScene(stream, poses_every_s=0.0)
        scene.draw(frame(0))
        scene.draw(_moved(1, (0.0, 7.0, 0.0)))
        scene.draw(keyframe(1))
        scene.finish()
    np.testing.assert_allclose(_lines(tmp_path / "path.rrd")["keyframes/0"][0], [0, 7, 0])


@pytest.mark.parametrize("correction_first", [False, True])
def test_a_fragment_that_joins_the_map_is_drawn_where_it_lies(tmp_path, correction_first):
    with _stream(tmp_path / "path.rrd") as stream:
        scene = RerunScene(stream, poses_every_s=1e3)
        for index in range(9):
            is_out = 3 <= index < 8
            scene.draw(_of_fragment(index, 1, index // 2) if is_out else _in_keyframe(index, 0))
        if correction_first:
            scene.draw(_moved(2, (0.0, 7.0, 0.0)))
        for k, own, y in ((1, 1, 5.0), (2, 3, 6.0)):  # the first pose in the map comes before them
            joined = msgspec.structs.replace(keyframe(k), t=(0.0, y, 0.0), fragment=1)
            scene.draw(msgspec.structs.replace(joined, fragment_keyframe=own))
        if not correction_first:
            scene.draw(_moved(2, (0.0, 7.0, 0.0)))
        scene.finish()
    lines = _lines(tmp_path / "path.rrd")
    expected = [[x, 5, 0] for x in (3, 4, 5)] + [[x, 7, 0] for x in (6, 7)]
    np.testing.assert_allclose(lines["trajectory/fragment/1"], expected, atol=1e-6)
    np.testing.assert_allclose(lines["lost/0"], [[2, 0, 0], expected[0]], atol=1e-6)


def test_the_gap_ends_at_the_fragment_if_that_is_drawn_before_the_next_pose(tmp_path):
    with _stream(tmp_path / "path.rrd") as stream:
        path = RerunPath(stream)
        for index in range(8):
            path.add(_of_fragment(index, 1, 0) if index >= 3 else _in_keyframe(index, 0))
        joined = msgspec.structs.replace(keyframe(1), t=(0.0, 5.0, 0.0), fragment=1)
        path.add_keyframe(msgspec.structs.replace(joined, fragment_keyframe=0))
        path.draw()
        path.add(_in_keyframe(8, 0))
        path.draw()
    lines = _lines(tmp_path / "path.rrd")
    begin, end = lines["lost/0"]
    np.testing.assert_allclose(begin, [2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(end, lines["trajectory/fragment/1"][0], atol=1e-6)


def test_a_fragment_that_stays_out_is_not_drawn(tmp_path):
    with _stream(tmp_path / "path.rrd") as stream:
        path = RerunPath(stream)
        for index in range(9):
            is_out = 3 <= index < 6
            path.add(_of_fragment(index, 1, 0) if is_out else _in_keyframe(index, 0))
        path.draw()
    assert sorted(_lines(tmp_path / "path.rrd")) == ["lost/0", "trajectory/0", "trajectory/1"]


def test_of_a_long_fragment_every_nth_frame_is_kept():
    path = FragmentPath(1)
    for index in range(5000):
        path.add(_of_fragment(index, 1, 0))
    path.add_keyframe(msgspec.structs.replace(keyframe(1), fragment=1, fragment_keyframe=0))
    assert [placed.t[0] for placed in path.placed()] == [1 + x for x in range(0, 5000, 8)]


@contextmanager
def _stream(recording: Path) -> Iterator[rr.RecordingStream]:
    stream = rr.RecordingStream("hsslam", recording_id="path")
    stream.set_sinks(rr.FileSink(recording))
    yield stream
    stream.flush()
    stream.disconnect()


def _lines(recording: Path) -> dict[str, np.ndarray]:
    """The first points of each line as drawn last, by its entity under /world."""
    found, entity = {}, ""
    for line in rrd("print", "-vvv", recording).splitlines():
        if head := re.search(r" rows .* - /world/(\S+) ", line):
            entity = head[1]
        elif "[[[" in line:  # what does not fit into the column is left out
            points = re.findall(r"\[([^][]+, [^][]+, [^][]+)\]", line)
            found[entity] = np.array([point.split(", ") for point in points], float)
    return found


def _in_keyframe(index: int, k: int) -> Pose:
    """At x = index; its keyframe is at 0."""
    at = [float(index), 0.0, 0.0, *_AT_REST]
    return msgspec.structs.replace(pose(index), keyframe=k, in_keyframe=at)


def _of_fragment(index: int, fragment: int, k: int) -> Pose:
    return msgspec.structs.replace(pose(index, "lost"), fragment=fragment, keyframe=k)


def _moved(k: int, t, q=_AT_REST) -> Correction:
    return Correction(
        pose_version=1, base_version=0, keyframes=[k], t=[t], q=[q], loss_before=2.0, loss_after=1.0
    )
