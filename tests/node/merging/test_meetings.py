"""Keyframes of two sessions that show the same, and which of these meetings agree."""

import numpy as np

from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.merging.meetings import Meeting, agreeing, find_meetings, places_apart
from hsslam_node.place_recognition.picture_agreement import PictureAgreement
from tests.small_room import SMALL, displaced, pose_error
from tests.two_sessions import FIRST, SECOND, in_mirror, meetings, session, walk

_T_WORLDS = se3_exp(np.array([3.0, -0.2, 1.0, 0.0, 1.1, 0.1]))


def test_sessions_from_different_starts_meet_at_several_places():
    found, poses = meetings(), walk()[1]
    assert {m.second for m in found} == set(range(8))
    assert places_apart(found) >= 3
    T_worlds = inverse(poses[0]) @ poses[1]
    for meeting in found:
        off_m, off_deg = pose_error(meeting.T_worlds, T_worlds)
        assert off_m < 0.02 and off_deg < 0.5


def test_a_place_and_its_mirror_image_do_not_meet():
    (first, _), (second, _) = session(FIRST), session(SECOND, mirrored=True)
    frames = in_mirror(walk()[0][SECOND])
    found = find_meetings(first, frames, second.poses(), SMALL.tracker)
    assert places_apart(agreeing(found)) < 3


def test_meetings_that_tell_of_another_place_are_left_out():
    right = [_meeting(k, np.eye(4)) for k in range(4)]
    wrong = [_meeting(k, displaced(np.eye(4), 0.5, 10.0, seed=k)) for k in range(4, 7)]
    found = agreeing([*wrong, *right])
    assert sorted(m.second for m in found) == [0, 1, 2, 3]
    assert agreeing([]) == []


def test_meetings_agree_as_far_as_maps_drift():
    turned = np.eye(4)
    turned[:3, 3] = 0.4, 0.0, 0.0
    near, far = _meeting(1, turned), _meeting(15, turned)
    assert len(agreeing([_meeting(0, np.eye(4)), near])) == 1
    assert len(agreeing([_meeting(0, np.eye(4)), far])) == 2


def test_many_looks_at_one_thing_are_one_place():
    looks = [_meeting(k, np.eye(4), shown=(0.2 * k, 0.0, 0.0)) for k in range(5)]
    assert places_apart(looks) == 1
    assert places_apart([*looks, _meeting(5, np.eye(4), shown=(0.0, 2.0, 0.0))]) == 2
    assert places_apart([]) == 0


def _meeting(k: int, T_off: np.ndarray, shown=(0.0, 0.0, 0.0)) -> Meeting:
    """Keyframes that stand at one place, a metre on for each k, but for what the match says wrong."""
    T_world_first = np.eye(4)
    T_world_first[:3, 3] = float(k), 0.0, 0.0
    T_world_second, seen = inverse(_T_WORLDS) @ T_world_first, np.array(shown)
    return Meeting(k, k, T_off, T_world_first, T_world_second, seen, PictureAgreement(20, 20))
