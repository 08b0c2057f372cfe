"""Frames with readings of an IMU: the tracker turns predictions by them, and learns which way is up."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_exp
from hsslam_node.inertial.gravity import STANDARD_GRAVITY
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.inertial.simulated import simulated_imu
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.sources.synth import synth_truth
from hsslam_node.tracking.inertial.prior import InertialPrior
from hsslam_node.tracking.motion import CameraMotion
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracker import Tracker
from tests.small_room import OPTIONS, SMALL, pose_error, room_frames, room_poses, with_black

_RATE_HZ = 5.0  # as if it moved so slowly: eight seconds, in which the camera turns
_NOT_TURNED = replace(SMALL, tracker=replace(SMALL.tracker, inertial_rotation=False))


def _up() -> np.ndarray:
    """[3] in the world of the tracker, the first camera's."""
    return synth_truth("room", OPTIONS)[0].T_world_cam[0, 2, :3]


def _readings(noise: float = 1.0) -> list[ImuReading | None]:
    return simulated_imu(room_poses(), _RATE_HZ, _up(), noise, seed=1)


def _tracked(frames: Sequence[Frame], config=SMALL) -> tuple[KeyframeStore, list[TrackResult]]:
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    tracker = Tracker(config, store, 0)
    return store, [tracker.track(frame, None) for frame in frames]


def _with(readings: Sequence[ImuReading | None]) -> list[Frame]:
    return [replace(f, imu=r) for f, r in zip(room_frames(), readings, strict=True)]


def test_gravity_is_learnt_and_unused_readings_change_no_bit_of_a_pose():
    store, results = _tracked(_with(_readings()), _NOT_TURNED)
    assert store.world_frame.gravity is not None
    off_deg = np.degrees(np.arccos(np.clip(_up() @ store.world_frame.gravity.up, -1, 1)))
    assert off_deg < 0.5 and not any(r.imu_disagrees for r in results)
    without, alone = _tracked(room_frames(), _NOT_TURNED)
    assert without.world_frame.gravity is None
    for one, other in zip(results, alone, strict=True):
        np.testing.assert_array_equal(one.T_world_cam, other.T_world_cam)
    _, turned = _tracked(_with(_readings()))
    assert any((a.T_world_cam != b.T_world_cam).any() for a, b in zip(turned, alone, strict=True))
    off_m = [pose_error(r.T_world_cam, room_poses()[r.frame_index])[0] for r in turned]
    assert max(off_m) < 0.006


def test_an_imu_with_other_axes_is_found_out_and_not_used():
    T = room_poses().copy()
    T[:, :3, :3] = T[:, :3, :3] @ so3_exp(np.array([0.0, 0.0, 1.6]))  # not said to the tracker
    _, results = _tracked(_with(simulated_imu(T, 30.0, _up(), 1.0, seed=1)))
    assert results[-1].imu_disagrees
    assert {r.status for r in results[1:]} == {"tracked"}


@pytest.mark.parametrize("length", [1.0, 0.0], ids=["in g", "a gyroscope alone"])
def test_accelerations_that_are_not_gravity_are_found_out(length: float):
    per_velocity = np.array([1, 1, 1, 1, *[length / STANDARD_GRAVITY] * 3, 1])
    wrong = [r and ImuReading(r.numbers * per_velocity, r.series) for r in _readings()]
    store, results = _tracked(_with(wrong))
    assert store.world_frame.gravity is None
    assert results[-1].implausible_gravity == pytest.approx(length, abs=0.15)


def _signs_changed() -> list[ImuReading | None]:
    signs = np.array([1, 1, 1, 1, -1, -1, -1, 1])
    return [r and ImuReading(r.numbers * signs, r.series) for r in _readings()]


def test_accelerations_with_the_other_sign_are_found_out():
    store, results = _tracked(_with(_signs_changed()))
    assert store.world_frame.gravity is None
    assert results[-1].implausible_gravity == pytest.approx(-STANDARD_GRAVITY, abs=0.3)


def test_a_camera_upside_down_has_gravity_if_the_level_frame_is_known():
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    T_level_world = np.eye(4)
    T_level_world[:3, :3] = [
        [1.0, 0.0, 0.0],
        [0.0, 0.0, -1.0],
        [0.0, 1.0, 0.0],
    ]  # y of images is up
    store.world_frame.note_level(T_level_world)
    tracker = Tracker(SMALL, store, 0)
    results = [tracker.track(frame, None) for frame in _with(_signs_changed())]
    gravity = store.world_frame.gravity
    assert gravity is not None and gravity.up[1] > 0.9
    assert all(r.implausible_gravity is None for r in results)


def test_accelerations_with_gravity_are_used():
    store, results = _tracked(_with(_readings()))
    assert store.world_frame.gravity is not None
    assert all(r.implausible_gravity is None for r in results)


def test_a_camera_that_turned_in_the_dark_is_expected_where_it_looks():
    """The lens is covered while the camera turns by 4 degrees: the prediction has that turn."""
    covered = range(20, 32)
    frames = [with_black(f) if f.index in covered else f for f in _with(_readings())]
    _, results = _tracked(frames)
    assert {r.status for r in results[20:32]} == {"lost"}
    last = results[31]
    T = room_poses()
    turned_rad = pose_error(T[19], T[31])[1]
    off_rad = pose_error(last.T_world_cam, T[31])[1]
    assert turned_rad > 0.05 and off_rad < 0.1 * turned_rad
    assert results[32].status == "tracked"


def test_a_prediction_is_turned_by_what_the_imu_saw_since():
    store = KeyframeStore.create(MemoryAllocator(), room_frames()[0].camera, 5000.0, 4)
    prior, readings, T = InertialPrior(store, True), _readings(noise=0.0), room_poses()
    store.append(room_frames()[0], T[0])
    prior.restart(readings[0])
    for k in range(1, 20):
        prior.take(readings[k])
        prior.aligned(readings[k], inverse(T[k - 1]) @ T[k], 0, T[k])
    for k in (20, 21, 21):  # two frames that are not aligned; one is tried again
        prior.take(readings[k])
    np.testing.assert_allclose(prior.turned(T[19], T[19])[:3, :3], T[21, :3, :3], atol=1e-6)
    prior.take(None)
    np.testing.assert_array_equal(prior.turned(T[19], T[19]), T[19])


class _Followed:
    """The motion of a camera along the true path, in a map whose world is T_map_room [4, 4] from the room."""

    def __init__(self, T_map_room: np.ndarray, readings: Sequence[ImuReading | None]) -> None:
        first = room_frames()[0]
        units = first.depth_units_per_m
        self.store = KeyframeStore.create(MemoryAllocator(), first.camera, units, 8)
        self.motion = CameraMotion(SMALL.tracker, self.store)
        self._frames, self._T = _with(readings), T_map_room @ room_poses()

    def begin(self, k: int) -> None:
        self.motion.begin(self._frames[k], self.add_keyframe(k))

    def add_keyframe(self, k: int) -> int:
        return self.store.append(self._frames[k], self._T[k])

    def go_on(self, numbers: range) -> None:
        keyframe = self.store.count - 1
        T_keyframe_world = inverse(self.store.pose(keyframe))
        for k in numbers:
            self.motion.take(self._frames[k])
            T_keyframe_cam = T_keyframe_world @ self._T[k]
            self.motion.aligned(self._frames[k], self._T[k], keyframe, T_keyframe_cam)

    def off_rad(self, k: int) -> float:
        """Of the predicted rotation of a frame."""
        self.motion.take(self._frames[k])
        return np.radians(
            pose_error(self.motion.predicted(self._frames[k].stamp_ns), self._T[k])[1]
        )


def test_gravity_and_bias_of_a_fragment_go_on_in_the_map_that_it_joins():
    """The fragment has keyframes 0 and 1; the map gets 0 alone, with which 1 moves."""
    readings = _readings()
    T_fragment_room = se3_exp(np.array([3.0, -0.2, 1.0, 0.4, 1.1, -0.7]))
    of_map, of_fragment = _Followed(np.eye(4), readings), _Followed(T_fragment_room, readings)
    of_map.begin(0)
    of_fragment.begin(1)
    of_fragment.go_on(range(2, 18))
    of_fragment.add_keyframe(18)
    of_fragment.go_on(range(19, 34))
    copy = of_map.add_keyframe(1)
    T_copied = of_fragment.store.pose(0)
    T_own = inverse(T_copied) @ of_fragment.store.poses()
    place = FragmentPlace(inverse(T_fragment_room), np.zeros(3))
    joined = JoinedFragment(1, place, np.full(2, copy), T_own, np.stack([T_copied] * 2))
    of_map.motion.take_over(of_fragment.motion, joined)
    assert of_map.store.world_frame.gravity is None
    # by constant velocity 8e-4, by an IMU with its bias 1.5e-2
    assert of_map.off_rad(37) < 3e-4
    of_map.go_on(range(34, 40))
    gravity = of_map.store.world_frame.gravity
    assert gravity is not None and gravity.up @ _up() > np.cos(0.01)
