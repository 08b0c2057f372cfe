"""The path without jumps: corrections, gaps, resets and restarts of the tracker."""

from itertools import pairwise

import numpy as np
import pytest

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.epoch_poses import final_trajectory
from hsslam_node.map.pose_log import DEAD_RECKONED, LOST, TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_node.smooth_path import SmoothPath
from tests.small_room import displaced, room_frames

_STEP = se3_exp(np.array([0.02, 0.0, 0.01, 0.0, 0.03, 0.0]))
_ASIDE = se3_exp(np.array([4.0, 0.0, 1.0, 0.0, 0.7, 0.0]))  # pose of a fragment in the map
_FRAME_NS = 33_000_000
_A_SECOND = 30  # frames


class _Run:
    """A camera that moves by `_STEP` a frame; every fourth frame is a keyframe."""

    def __init__(self, robot: RobotFrames | None = None) -> None:
        self._robot = robot
        arrays, self._frame = MemoryAllocator(), room_frames()[0]
        camera, units = self._frame.camera, self._frame.depth_units_per_m
        self.store = KeyframeStore.create(arrays, camera, units, 64)
        self.log = PoseLog(arrays)
        self.restart()
        self.T_world_cam = np.eye(4)
        self._frames = 0

    def restart(self) -> None:
        self._path = SmoothPath(self.log, 0.5, self._robot)

    def track(
        self, status: int = TRACKED, map_epoch: int = 0, gap: int = 1, *, is_carried: bool = False
    ) -> np.ndarray:
        """T_odom_cam of the next frame."""
        n = self._frames
        self._frames += gap
        if n:
            self.T_world_cam = self.T_world_cam @ _STEP
        if n % 4 == 0:
            self.store.append(self._frame, self.T_world_cam)
        k = self.store.count - 1
        row = pose_row(
            index=n, source_stamp_ns=n * _FRAME_NS, stamp_ns=n, publish_ns=n, status=status,
            keyframe=k, T_world_cam=self.T_world_cam,
            T_keyframe_cam=inverse(self.store.pose(k)) @ self.T_world_cam, quality=1.0,
            map_version=1, map_epoch=map_epoch,
        )  # fmt: skip
        self._path.add(row, self.store, is_carried=is_carried)
        self.log.append(row)
        return row["T_odom_cam"].copy()

    def track_in_fragment(
        self, T_world_cam: np.ndarray, T_expected: np.ndarray | None = None, *, is_reckoned: bool
    ) -> None:
        """The next frame, in fragment 1, whose keyframe 0 is in its origin."""
        n = self._frames
        self._frames += 1
        row = pose_row(
            index=n, source_stamp_ns=n * _FRAME_NS, stamp_ns=n, publish_ns=n, status=LOST,
            keyframe=0, T_world_cam=T_world_cam, T_keyframe_cam=T_world_cam, quality=1.0,
            map_version=1, fragment=1, is_reckoned=is_reckoned,
        )  # fmt: skip
        self._path.add(row, self.store, T_expected)
        self.log.append(row)

    def correct(self) -> None:
        """Move the newest keyframe by 5 cm and 2 degrees, and the camera with it."""
        k = self.store.count - 1
        moved = displaced(self.store.pose(k), 0.05, 2.0)
        self.T_world_cam = moved @ inverse(self.store.pose(k)) @ self.T_world_cam
        self.store.correct_poses(np.array([k]), moved[None])


@pytest.fixture
def run() -> _Run:
    return _Run()


def _steps(poses: list[np.ndarray]) -> np.ndarray:
    return np.stack([inverse(a) @ b for a, b in pairwise(poses)])


def test_without_corrections_it_is_the_path_in_the_world(run):
    for _ in range(10):
        np.testing.assert_allclose(run.track(), run.T_world_cam, atol=1e-12)


def test_corrections_make_no_jump(run):
    poses = []
    for n in range(20):
        poses.append(run.track())
        if n in (5, 7, 12):
            run.correct()
    np.testing.assert_allclose(_steps(poses), [_STEP] * 19, atol=1e-9)
    assert np.abs(poses[-1] - run.T_world_cam).max() > 0.05


def test_a_restarted_tracker_goes_on_with_it(run):
    poses = [run.track() for _ in range(6)]
    run.correct()
    run.restart()
    poses += [run.track() for _ in range(6)]
    np.testing.assert_allclose(_steps(poses), [_STEP] * 11, atol=1e-9)


def test_it_stands_still_where_the_motion_is_not_known(run):
    before = [run.track() for _ in range(3)][-1]
    np.testing.assert_array_equal(run.track(status=LOST, gap=20), before)
    np.testing.assert_array_equal(run.track(), before)
    np.testing.assert_allclose(run.track(), before @ _STEP, atol=1e-12)


def test_a_short_loss_is_bridged(run):
    before = [run.track() for _ in range(3)][-1]
    run.track(status=LOST)
    np.testing.assert_allclose(run.track(), before @ _STEP @ _STEP, atol=1e-12)


def test_it_goes_on_in_another_map(run):
    before = [run.track() for _ in range(3)][-1]
    run.T_world_cam = np.eye(4)
    np.testing.assert_array_equal(run.track(map_epoch=1), before)


def test_a_camera_found_elsewhere_makes_no_jump_however_soon_that_is(run):
    before = [run.track() for _ in range(3)][-1]
    run.track(status=LOST)
    run.T_world_cam = displaced(run.T_world_cam, 3.0, 40.0)
    np.testing.assert_array_equal(run.track(is_carried=True), before)
    np.testing.assert_allclose(run.track(), before @ _STEP, atol=1e-12)
    assert run.log.rows()["odometry_stands"].tolist() == [1, 0, 0, 1, 1, 0]


def test_height_and_tilt_are_those_of_the_map_where_the_motion_is_not_known():
    """In a saved map, and again where the camera is found elsewhere: a tilt must not stay for all the run."""
    robot = RobotFrames()
    run = _Run(robot)
    run.store.world_frame.note_level(robot.T_base_cam)
    run.T_world_cam = displaced(run.T_world_cam, 0.3, 10.0)
    begun = robot.base_pose(run.track())
    _expect_level(begun, np.eye(4), robot.base_pose(run.T_world_cam))
    before = robot.base_pose([run.track() for _ in range(3)][-1])
    run.T_world_cam = displaced(run.T_world_cam, 3.0, 40.0, seed=1)
    after = robot.base_pose(run.track(is_carried=True))
    _expect_level(after, before, robot.base_pose(run.T_world_cam))


def _expect_level(T_odom_base: np.ndarray, before: np.ndarray, T_map_base: np.ndarray) -> None:
    """x, y and heading [4, 4] are as before, height and tilt as in `map`."""
    np.testing.assert_allclose(T_odom_base[2], T_map_base[2], atol=1e-9)
    np.testing.assert_allclose(T_odom_base[:2, 3], before[:2, 3], atol=1e-9)
    headings = [np.arctan2(T[1, 0], T[0, 0]) for T in (T_odom_base, before)]
    assert abs(headings[0] - headings[1]) < 1e-9


def test_it_follows_a_camera_of_one_frame_a_second(run):
    for _ in range(6):
        np.testing.assert_allclose(run.track(gap=_A_SECOND), run.T_world_cam, atol=1e-12)
    before = run.track(gap=_A_SECOND)
    run.restart()
    np.testing.assert_allclose(run.track(gap=_A_SECOND), before @ _STEP, atol=1e-12)
    before = run.track(status=LOST, gap=_A_SECOND)
    np.testing.assert_array_equal(run.track(), before)


def test_frames_by_odometry_alone_keep_its_path_however_few_there_are_in_a_second(run):
    states, truth = [*3 * [TRACKED], *6 * [DEAD_RECKONED], TRACKED], []
    for status in states:
        run.track(status=status, gap=_A_SECOND)
        truth.append(run.T_world_cam)
    found = final_trajectory(run.log.rows(), run.store.poses()).T_world_cam
    np.testing.assert_allclose(found, truth, atol=1e-6)


def test_frames_by_odometry_alone_in_a_fragment_are_fitted_once_it_has_joined(run):
    """Odometry is a tenth too long; the camera sees again at the last of ten frames."""
    before = [run.track() for _ in range(3)][-1]
    too_long = se3_exp(1.1 * se3_log(_STEP))
    truth, by_odometry = [np.eye(4)], np.eye(4)
    run.track_in_fragment(truth[0], is_reckoned=False)
    for k in range(1, 10):
        truth.append(truth[-1] @ _STEP)
        by_odometry = by_odometry @ too_long
        if k < 9:
            run.track_in_fragment(by_odometry, is_reckoned=True)
        else:
            run.track_in_fragment(truth[-1], by_odometry, is_reckoned=False)
    np.testing.assert_allclose(run.track(is_carried=True), before @ by_odometry, atol=1e-9)
    run.store.append(room_frames()[0], _ASIDE)
    run.log.prepare_join(1, np.array([run.store.count - 1]), np.eye(4)[None])
    run.log.join(1)
    rows = run.log.joined(run.log.rows())
    assert rows["status"].tolist() == [*4 * [TRACKED], *8 * [DEAD_RECKONED], *2 * [TRACKED]]
    found = final_trajectory(rows, run.store.poses()).T_world_cam[3:-1]
    off_m = np.linalg.norm(found[:, :3, 3] - (_ASIDE @ truth)[:, :3, 3], axis=1)
    assert off_m.max() < 0.001 < np.linalg.norm((by_odometry - truth[-1])[:3, 3])
