"""Which frames count as new, whatever cameras do with their numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_proto.frame_order import (
    LARGEST_INDEX,
    LARGEST_STEP,
    MOST_REFUSED,
    FrameOrder,
    new_publisher,
    replayed_publisher,
)


def _taken(order: FrameOrder, publisher: int, indices: list[int], first_ns: int = 0) -> list[int]:
    """Publishers of the places of frames that are taken, one stamp later each."""
    found = []
    for number, index in enumerate(indices):
        place = order.place(publisher, index, first_ns + number)
        assert place.kind == "new"
        order.take(place)
        found.append(place.publisher)
    return found


def test_a_named_camera_never_goes_back():
    order, camera = FrameOrder(), new_publisher()
    _taken(order, camera, [0, 1, 5])
    assert order.place(camera, 5, 99).kind == "old"
    assert order.place(camera, 2, 99).kind == "old"
    assert order.place(camera, 6 + LARGEST_STEP).kind == "absurd"
    assert order.place(camera, LARGEST_INDEX).kind == "absurd"
    assert order.place(camera, 5 + LARGEST_STEP).kind == "new"
    assert order.place(new_publisher(), 0).kind == "new"  # another one has its own count


def test_a_sender_without_a_number_begins_anew_with_a_later_stamp():
    order = FrameOrder()
    assert set(_taken(order, 0, [0, 1, 2], first_ns=10)) == {0}
    assert order.place(0, 2, 12).kind == "old"  # sent again
    assert order.place(0, 1, 11).kind == "old"  # comes late
    first, second = _taken(order, 0, [0, 1], first_ns=100)
    assert first == second != 0
    assert order.place(0, 1, 101).publisher == first
    (third,) = _taken(order, 0, [0], first_ns=200)
    assert third not in (0, first)


def _new(order: FrameOrder, camera: int, indices: list[int], first_ns: int) -> list[int]:
    """The indices that are taken, one stamp later each; the others are refused."""
    found = []
    for stamp_ns, index in enumerate(indices, first_ns):
        place = order.place(camera, index, stamp_ns)
        if place.kind == "new":
            order.take(place)
            found.append(index)
        else:
            order.refuse(place)
    return found


@pytest.mark.parametrize("camera", [7, new_publisher()], ids=["from attachment", "named"])
def test_a_camera_whose_count_jumps_is_new_again_after_ten_frames(camera: int):
    order = FrameOrder()
    first = LARGEST_INDEX - 30
    jumped = [first + k for k in range(MOST_REFUSED + 3)]
    assert _new(order, camera, [0, 1, *jumped], 0) == [0, 1, *jumped[MOST_REFUSED:]]
    assert order.place(camera, jumped[-1], 14).kind == "old"
    assert order.place(camera, jumped[-1] + 1, 15).kind == "new"


def test_frames_of_a_camera_whose_index_is_a_time_in_ns_are_new():
    times = [33_333_333 * k for k in range(40)]
    assert _new(FrameOrder(), new_publisher(), times, 0) == [0, *times[MOST_REFUSED + 1 :]]


def test_absurd_indices_beside_those_of_the_camera_stay_refused():
    order, camera = FrameOrder(), new_publisher()
    for k in range(30):
        row = [k, *(2**50 + 9 * k + j for j in range(MOST_REFUSED - 1))]
        assert _new(order, camera, row, 10 * k) == [k]


def test_a_camera_whose_count_jumps_is_new_again_beside_another_camera():
    order, camera, other = FrameOrder(), new_publisher(), new_publisher()
    order.is_new(camera, 0)
    kinds = []
    for k in range(MOST_REFUSED + 2):
        assert _new(order, other, [k], k) == [k]
        kinds.append(bool(_new(order, camera, [2**50 + k], k)))
    assert kinds == MOST_REFUSED * [False] + 2 * [True]


def test_frames_that_were_not_refused_are_new_behind_a_jump():
    """As poses in the mapper, and frames in a log. A reader of a log learns of each jump."""
    order, camera = FrameOrder(), new_publisher()
    assert [order.is_new(camera, index) for index in (3, 2**50, 2**50, 2**50 + 1)] == [
        True, True, False, True
    ]  # fmt: skip
    for index in (2**51, 2**52):
        assert order.place(camera, index).kind == "absurd"
        assert order.is_new(camera, index)


def test_a_restarted_reader_goes_on_with_the_count_that_it_left():
    order = FrameOrder()
    _taken(order, 7, [0, 1])
    (second,) = _taken(order, 7, [0], first_ns=100)
    again = FrameOrder()
    again.resume(7, 1, 1)
    again.resume(second, 0, 100)
    assert again.place(7, 0, 100) == order.place(7, 0, 100)
    assert again.place(7, 1, 101) == order.place(7, 1, 101)
    assert again.place(7, 0, 102).publisher not in (7, second)


def test_a_restarted_reader_refuses_no_camera_whose_index_is_a_time_in_ns():
    order, camera = FrameOrder(), new_publisher()
    for index in (33_333_333, 66_666_666):
        order.resume(camera, index, index)
    assert order.place(camera, 99_999_999, 99_999_999).kind == "new"


def test_old_cameras_are_forgotten_and_the_newest_are_not():
    order = FrameOrder()
    cameras = [new_publisher() for _ in range(200)]
    for camera in cameras:
        _taken(order, camera, [3])
    assert order.place(cameras[-1], 3).kind == "old"
    assert order.place(cameras[0], 3).kind == "new"


@given(
    st.integers(0, 2**63 - 1),
    st.lists(st.tuples(st.integers(0, LARGEST_INDEX), st.integers(0, 2**62)), max_size=20),
)
def test_whatever_comes_a_frame_that_was_taken_is_not_new_when_it_is_sent_again(publisher, frames):
    order = FrameOrder()
    for index, stamp_ns in frames:
        place = order.place(publisher, index, stamp_ns)
        if place.kind == "new":
            order.take(place)
            assert order.place(publisher, index, stamp_ns).kind == "old"
        assert 0 <= place.publisher < 2**63


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1))
def test_a_replay_keeps_cameras_apart_and_names_them_anew(camera, other):
    replay = new_publisher()
    named = {replayed_publisher(c, replay) for c in (camera, other)}
    assert all(2**62 <= number < 2**63 for number in named)
    if (camera ^ other) % 2**62:
        assert len(named) == 2
