"""A viewer shows the run so far again after the recorder was restarted."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rerun as rr

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.pose_log import LOST, TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.map_state import MapState
from hsslam_services.viewer import earlier_run
from hsslam_services.viewer.earlier_run import read_earlier_run
from hsslam_services.viewer.scene import RerunScene
from tests.services.recorded import rrd
from tests.services.wire_samples import frame, pose

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_FRAMES, _KEYFRAMES_EVERY = 2000, 500
_LOST = range(1200, 1210)
_RAISED_M = 3.0  # by the correction of the second half


def _at(x: float, y: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:2, 3] = x, y
    return T


@pytest.fixture
def arena(tmp_path) -> Arena:
    """The camera moved along x, 1 cm a frame, was lost once, and the keyframes of the second half were
    corrected after it."""
    folder = tmp_path / "arena"
    folder.mkdir()
    MapState.create(folder, localise_only=False)
    arena = Arena(folder)
    store, log = KeyframeStore.create(arena, _CAMERA, 1000.0, 8), PoseLog(arena)
    image = Frame(0, 0, _CAMERA, np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), np.uint16), 1000.0)
    for index in range(_FRAMES):
        T, k = _at(index / 100), index // _KEYFRAMES_EVERY
        if index % _KEYFRAMES_EVERY == 0:
            store.append(image, T)
        log.append(
            pose_row(
                index=index, source_stamp_ns=index, stamp_ns=10**18 + index, publish_ns=0,
                status=LOST if index in _LOST else TRACKED, keyframe=k, T_world_cam=T,
                T_keyframe_cam=inverse(store.pose(k)) @ T, quality=0.9, map_version=1,
            )
        )  # fmt: skip
    store.correct_poses(np.array([2, 3]), np.stack([_at(10, _RAISED_M), _at(15, _RAISED_M)]))
    return arena


def test_it_is_at_the_present_poses_and_parted_where_the_camera_was_lost(arena):
    earlier = read_earlier_run(arena.folder, newest_left_out=600)
    assert earlier is not None
    assert [k for k, _ in earlier.keyframes] == [0, 1, 2, 3]
    np.testing.assert_allclose(earlier.keyframes[3][1][0], [15, _RAISED_M, 0], atol=1e-6)
    before, after = (np.array([p.t for p in line]) for line in earlier.lines)
    np.testing.assert_allclose(before[:, 0], np.arange(0, 1200, 8) / 100, atol=1e-6)
    np.testing.assert_allclose(after[:, 0], np.arange(1216, 1400, 8) / 100, atol=1e-6)
    np.testing.assert_allclose(before[:, 1], _RAISED_M * (before[:, 0] >= 10), atol=1e-6)
    np.testing.assert_allclose(after[:, 1], _RAISED_M, atol=1e-6)


def test_a_long_path_is_thinned_and_its_beginning_left_out(arena, monkeypatch):
    monkeypatch.setattr(earlier_run, "_MOST_POSES", 1000)
    monkeypatch.setattr(earlier_run, "_MOST_DRAWN", 50)
    earlier = read_earlier_run(arena.folder, newest_left_out=0)
    assert earlier is not None
    x = np.array([p.t[0] for line in earlier.lines for p in line])
    np.testing.assert_allclose(x[[0, -1]], [10.0, 19.8], atol=1e-6)
    np.testing.assert_allclose(np.diff(x).max(), 0.4, atol=1e-6)  # the lost frames lie between


def test_before_there_is_a_map_and_after_a_reset_there_is_none(arena, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    MapState.create(empty, localise_only=False)
    assert read_earlier_run(empty, 0) is None
    assert read_earlier_run(arena.folder, _FRAMES) is None
    MapState(arena.folder).map_epoch = 1
    assert read_earlier_run(arena.folder, 0) is None


def test_the_next_scene_replaces_what_the_former_drew_and_goes_on(arena, tmp_path):
    earlier = read_earlier_run(arena.folder, newest_left_out=600)
    assert earlier is not None
    stream = rr.RecordingStream("hsslam", recording_id="earlier")
    stream.set_sinks(rr.FileSink(tmp_path / "scene.rrd"))
    scene = RerunScene(stream, poses_every_s=0.0)
    scene.begin_with(earlier)
    scene.draw(msgspec.structs.replace(frame(_FRAMES), stamp_ns=10**18 + 1))
    for index in range(_FRAMES - 2, _FRAMES + 3):  # two that the former scene may have drawn
        at = msgspec.structs.replace(pose(index), stamp_ns=10**18 + index)
        scene.draw(at)
    scene.finish()
    stream.flush()
    stream.disconnect()
    entities = _entities(tmp_path / "scene.rrd")
    assert {"world/trajectory/old/1", "world/trajectory/old/2", "world/trajectory/0"} <= entities
    assert "world/keyframes/0" in entities
    for cleared in ("world/trajectory", "world/lost", "world/keyframes"):
        assert _frames(tmp_path / "scene.rrd", cleared) == {_FRAMES - 1}
    for line in ("old/1", "old/2", "0"):  # again, after what the former scene may have drawn
        assert _FRAMES in _frames(tmp_path / "scene.rrd", f"world/trajectory/{line}")
    assert not any(name.startswith("world/lost/") for name in entities)


def _entities(recording: Path) -> set[str]:
    return set(re.findall(r" rows .* - /(\S+) ", rrd("print", "-vv", recording)))


def _frames(recording: Path, entity: str) -> set[int]:
    """The frames at which something was drawn there."""
    found, here = set(), ""
    for line in rrd("print", "-vvv", recording).splitlines():
        if head := re.search(r" rows .* - /(\S*) ", line):
            here = head[1]
        elif here == entity and (stamp := re.search(r" 2001-09-09T01:46:40\.(\d+) ", line)):
            found.add(int(stamp[1].ljust(9, "0")))
    return found
