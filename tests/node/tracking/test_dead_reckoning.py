"""A covered lens with odometry: the camera is where wheels say, then where it sees; wrong odometry."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, transform
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.odometry.reading import OdometryReading
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_node.tracking.tracker import Tracker
from tests.small_room import SMALL, pose_error, room_frames, room_poses, with_black

_COVERED = range(12, 24)


def _wheels(noise: float = 0.01) -> list[OdometryReading]:
    return simulated_odometry(room_poses(), noise, seed=1)


def _frames(
    odometry: Sequence[OdometryReading | None], covered: Sequence[int] = _COVERED
) -> list[Frame]:
    frames = zip(room_frames(), odometry, strict=True)
    given = [replace(frame, odometry=reading) for frame, reading in frames]
    return [with_black(f) if f.index in covered else f for f in given]


def _tracked(frames: Sequence[Frame]) -> tuple[KeyframeStore, list[TrackResult]]:
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    tracker = Tracker(SMALL, store, 0)
    return store, [tracker.track(frame, None) for frame in frames]


def _off_m(results: Sequence[TrackResult]) -> np.ndarray:
    return np.array([pose_error(r.T_world_cam, room_poses()[r.frame_index])[0] for r in results])


def test_with_odometry_a_covered_camera_is_never_lost_and_makes_no_keyframe():
    store, results = _tracked(_frames(_wheels()))
    statuses = [r.status for r in results]
    assert statuses[1:12] == ["tracked"] * 11 and statuses[24:] == ["tracked"] * 16
    assert statuses[12:24] == ["dead_reckoned"] * 12
    assert _off_m(results).max() < 0.006
    assert not set(store.frame_indices().tolist()) & set(_COVERED)
    gaps = {k: store.gap_covariance(k) for k in range(store.count)}
    after = [k for k, index in enumerate(store.frame_indices()) if index >= 24]
    assert [k for k, gap in gaps.items() if gap.any()] == after[:1]
    dark = results[12:24]
    assert {r.quality for r in dark} == {0.0}
    sigmas = [np.sqrt(np.trace(r.covariance)) for r in dark if r.covariance is not None]
    assert len(sigmas) == 12 and (np.diff(sigmas) > 0).all()
    of_gap = np.sqrt(np.trace(gaps[after[0]]))
    assert sigmas[-1] < of_gap < sigmas[-1] + 0.005  # and what the alignment adds
    back = results[24]
    assert back.T_expected is not None and all(r.T_expected is None for r in results[25:])
    assert not any(r.is_carried for r in results)
    assert pose_error(back.T_expected, back.T_world_cam)[0] < 0.02


def test_without_odometry_it_is_lost():
    _, results = _tracked(_frames([None] * 40))
    assert [r.status for r in results[12:24]] == ["lost"] * 12


@pytest.mark.parametrize("missing", [[11], [10, 11], [15]], ids=["last seen", "two", "covered"])
def test_a_frame_without_a_reading_costs_at_most_itself(missing: list[int]):
    wheels = [None if k in missing else wheel for k, wheel in enumerate(_wheels())]
    _, results = _tracked(_frames(wheels))
    assert {r.frame_index for r in results if r.status == "lost"} == set(missing) & set(_COVERED)
    known = [r for r in results if r.status != "lost"]
    assert {r.status for r in known[12:22]} == {"dead_reckoned"} and _off_m(known).max() < 0.006
    assert results[24].T_expected is not None and not any(r.is_carried for r in results)


def test_a_motion_that_begins_long_after_the_last_reading_is_not_known():
    wheels = [None if 4 < k < 12 else wheel for k, wheel in enumerate(_wheels())]
    grown = [
        wheel and replace(wheel, covariance=0.04**2 * k * np.eye(6))
        for k, wheel in enumerate(wheels)
    ]
    _, results = _tracked(_frames(grown))
    assert [r.status for r in results[12:24]] == ["lost"] * 12


def test_odometry_is_believed_up_to_a_distance():
    wheels = _wheels()
    grown = [
        replace(wheel, covariance=0.04**2 * max(0, k - 11) * np.eye(6))  # 9.8 cm after 6 frames
        for k, wheel in enumerate(wheels)
    ]
    _, results = _tracked(_frames(grown))
    statuses = [r.status for r in results[12:24]]
    assert statuses == ["dead_reckoned"] * 6 + ["lost"] * 6
    assert [r.frame_index for r in results if r.is_carried] == [24]  # the first that sees again


def test_odometry_is_the_way_through_a_gap_also_if_the_camera_is_found_by_a_place():
    """Else the final trajectory keeps the error of the gap as a jump."""
    wheels, T_start = _wheels(), _wheels()[11].T_odom_cam
    far = []
    for wheel in wheels:
        T = wheel.T_odom_cam.copy()
        T[:3, 3] = T_start[:3, 3] + 3 * (T[:3, 3] - T_start[:3, 3])
        far.append(OdometryReading.at(T, wheel.covariance))
    _, results = _tracked(_frames(far, range(12, 26)))
    statuses = [r.status for r in results]
    again = statuses.index("tracked", 12)
    assert again > 26 and set(statuses[12:again]) == {"dead_reckoned"}
    back = results[again]
    assert pose_error(back.T_world_cam, room_poses()[again])[0] < 0.02
    assert back.T_expected is not None and not any(r.is_carried for r in results)
    assert pose_error(back.T_expected, back.T_world_cam)[0] > 0.1


def test_noise_of_odometry_does_not_pull_what_the_camera_sees():
    alone, with_wheels, with_poor = (
        _off_m(_tracked(_frames(odometry, covered=()))[1])
        for odometry in ([None] * 40, _wheels(), _wheels(0.1))
    )
    assert with_wheels.mean() < alone.mean() + 1e-4
    assert with_poor.mean() < alone.mean() + 3e-4


def test_noisy_odometry_moves_like_the_camera():
    _, results = _tracked(_frames(_wheels(0.1), covered=()))
    assert not any(r.odometry_disagrees for r in results)


@pytest.mark.parametrize("fault", ["a third of the way", "another mounting", "standing"])
def test_odometry_that_moves_unlike_the_camera_is_found_out(fault: str):
    wrong = []
    for wheel in _wheels():
        T = wheel.T_odom_cam.copy()
        if fault == "a third of the way":
            T[:3, 3] /= 3
        elif fault == "another mounting":
            T = T @ transform(np.zeros(3), np.array([0.5, -0.5, 0.5, 0.5]))
        else:
            T = np.eye(4)
        wrong.append(OdometryReading.at(T, wheel.covariance))
    _, results = _tracked(_frames(wrong, covered=()))
    assert results[-1].odometry_disagrees
    assert {r.status for r in results[1:]} == {"tracked"} and _off_m(results).max() < 0.006


def test_a_camera_that_sees_nothing_is_lost_if_odometry_moves_unlike_it():
    """Not published where the wheels of a robot stand that is carried away; no keyframe of it either."""
    still, covered = [_wheels()[0]] * 40, range(24, 36)
    store, results = _tracked(_frames(still, covered))
    assert [r.status for r in results[24:36]] == ["lost"] * 12
    assert not set(store.frame_indices().tolist()) & set(covered)


def test_a_person_can_say_where_a_dead_reckoned_camera_is():
    frames = _frames(_wheels())
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    tracker = Tracker(SMALL, store, 0)
    for frame in frames[: _COVERED[3]]:
        last = tracker.track(frame, None)
    assert last.status == "dead_reckoned"
    k = _COVERED[3]
    near = Whereabouts(room_poses()[k], np.array([0.0, -1.0, 0.0]))
    found = tracker.find_near(room_frames()[k], None, near)
    assert found is not None and pose_error(found.T_world_cam, room_poses()[k])[0] < 0.02


def test_wheels_that_slip_or_stand_still_do_not_lose_the_camera():
    still = [_wheels()[0]] * 40
    _, results = _tracked(_frames(still, covered=()))
    assert all(r.status == "tracked" for r in results[1:]) and _off_m(results).max() < 0.005
    readings = _wheels()
    T_slip = np.eye(4)
    T_slip[0, 3] = 0.12
    slipped = readings[:20] + [
        OdometryReading.at(inverse(T_slip) @ r.T_odom_cam, r.covariance) for r in readings[20:]
    ]
    _, results = _tracked(_frames(slipped, covered=()))
    assert all(r.status == "tracked" for r in results[1:]) and _off_m(results).max() < 0.005


def test_what_no_keyframe_shows_becomes_one_where_odometry_says_that_the_camera_is():
    options = SourceOptions(frames=260, synth=SynthOptions(width_px=160, height_px=120))
    truth = open_ground_truth("synth:room", options)
    assert truth
    chosen = [*range(12), *range(20, 200, 10), *range(200, 260)]  # on the way the lens is covered
    poses = inverse(truth.T_world_cam[0]) @ truth.T_world_cam[chosen]
    wheels = dict(zip(chosen, simulated_odometry(poses, 0.01, seed=1), strict=True))
    frames = [
        replace(with_black(f) if 12 <= f.index < 200 else f, odometry=wheels[f.index])
        for f in open_source("synth:room", options).frames()
        if isinstance(f, Frame) and f.index in wheels
    ]
    store, results = _tracked(frames)
    statuses = [r.status for r in results if r.frame_index >= 200]
    anew = statuses.index("tracked")
    assert statuses == ["dead_reckoned"] * anew + ["tracked"] * (60 - anew) and 20 <= anew < 40
    k = store.frame_indices().tolist().index(200 + anew)
    unsure_m = np.sqrt(np.linalg.eigvalsh(store.gap_covariance(k)[:3, :3])[-1])
    off = pose_error(store.pose(k), inverse(truth.T_world_cam[0]) @ truth.T_world_cam[200 + anew])
    assert off[0] < 3 * unsure_m < 0.3
    assert results[12 + 18 + anew].is_keyframe and store.count > k + 1
