"""Which meetings of a fragment with the map are enough to join them, and which are not."""

import numpy as np

from hsslam_node.fragments.join_decision import agreed_meetings, fragment_place
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.merging.meetings import Meeting, elsewhere
from hsslam_node.place_recognition.picture_agreement import PictureAgreement
from tests.small_room import displaced, pose_error

_T_MAP_FRAGMENT = se3_exp(np.array([3.0, -0.2, 1.0, 0.0, 1.1, 0.1]))
_SAME, _OTHER_PICTURES = PictureAgreement(39, 40), PictureAgreement(26, 40)


def _meeting(k: int, T_off: np.ndarray | None = None, pictures=_SAME) -> Meeting:
    """Keyframe k of the fragment stands where keyframe k of the map does, 1.5 m on for each k; the match is
    wrong by `T_off`."""
    T = np.eye(4)
    T[:3, 3] = 1.5 * k, 0.0, 0.0
    T_fragment = inverse(_T_MAP_FRAGMENT) @ T
    wrong = np.eye(4) if T_off is None else T_off
    return Meeting(k, k, wrong, T, T_fragment, T_fragment[:3, 3], pictures)


def test_three_places_that_agree_tell_where_the_fragment_lies():
    meetings = [_meeting(k, displaced(np.eye(4), 0.005, 0.1, seed=k)) for k in range(3)]
    agreed = agreed_meetings(meetings)
    assert len(agreed) == 3
    place = fragment_place(agreed)
    off_m, off_deg = pose_error(place.T_map_fragment, _T_MAP_FRAGMENT)
    assert off_m < 0.03 and off_deg < 0.2
    assert place.met_m.tolist() in [m.T_world_second[:3, 3].tolist() for m in agreed]


def test_two_places_are_not_enough():
    assert agreed_meetings([]) == []
    assert agreed_meetings([_meeting(0), _meeting(1), _meeting(1)]) == []


def test_rooms_of_one_shape_with_other_pictures_are_not_the_same_room():
    meetings = [_meeting(k, pictures=_OTHER_PICTURES) for k in range(6)]
    assert agreed_meetings(meetings) == []


def test_two_ways_to_lie_are_not_told_apart():
    aside = np.eye(4)
    aside[:3, 3] = 0.0, 4.0, 0.0
    one, other = [_meeting(k) for k in range(6)], [_meeting(k, aside) for k in range(6)]
    assert len(agreed_meetings(one)) == 6
    assert agreed_meetings([*one, *other]) == []
    assert agreed_meetings([*one, *other[:3]]) == []
    assert len(agreed_meetings([*one, *other[:2]])) == 6


def test_drift_is_no_other_place_and_another_room_is():
    drifted, moved, turned = (
        displaced(np.eye(4), m, deg) for m, deg in ((0.6, 10), (1.5, 0), (0, 40))
    )
    meetings = [_meeting(2), _meeting(3, drifted), _meeting(4, moved), _meeting(5, turned)]
    assert [m.second for m in elsewhere(meetings, _T_MAP_FRAGMENT)] == [4, 5]
