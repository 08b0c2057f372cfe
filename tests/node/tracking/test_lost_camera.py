"""A camera that is lost: found again at a keyframe, nowhere else, and what its way there is worth."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.geometry.pose_covariance import UNTRACKED
from tests.node.tracking.test_tracker import _is_right, _store, _tracked
from tests.small_room import room_frames, with_black


def test_a_lost_camera_is_found_again_at_a_keyframe():
    """It comes back where it was 24 frames ago, too far for the last good pose."""
    store = _store()
    frames = room_frames()
    tracker, _ = _tracked(store, frames[:30])
    stamp_ns = frames[29].stamp_ns
    lost = [
        tracker.track(with_black(frames[29], stamp_ns=stamp_ns + k * 33_000_000), None)
        for k in (1, 2)
    ]
    assert [r.status for r in lost] == ["lost", "lost"]
    back = [
        tracker.track(replace(frames[5 + k], stamp_ns=stamp_ns + (3 + k) * 33_000_000), None)
        for k in range(4)
    ]
    assert all(map(_is_right, back))
    # their poses follow the keyframe that they are aligned to, not the newest one, from before the loss
    beside = [r for r in back if not r.is_keyframe]
    assert beside and all(store.frame_indices()[r.keyframe] < 12 for r in beside)
    assert [r.is_carried for r in back] == [True, False, False, False]


@pytest.mark.parametrize(("start", "is_untracked"), [(5, True), (30, False)])
def test_the_motion_to_a_place_found_again_is_not_taken_for_tracked(start, is_untracked):
    """The first keyframe there has an unsure way from the newest; one that follows it, or the frames before
    the loss, has not."""
    store, frames = _store(), room_frames()
    tracker, _ = _tracked(store, frames[:30])
    count, stamp_ns = store.count, frames[29].stamp_ns
    for n, frame in enumerate([with_black(frames[29]), *frames[start : start + 9]], 1):
        tracker.track(replace(frame, stamp_ns=stamp_ns + n * 33_000_000), None)
    gaps = [store.gap_covariance(k) for k in range(store.count)]
    assert store.count >= count + 2
    assert [bool(gap.any()) for gap in gaps[count - 1 : count + 2]] == [False, is_untracked, False]
    if is_untracked:
        assert (np.linalg.eigvalsh(gaps[count] - 0.99 * UNTRACKED) > 0).all()


def test_being_carried_while_lost_is_no_motion_to_go_on_with():
    """Frame 29, black, frame 5, black: the last one is expected at frame 5, not as far beyond it as that is
    from 29."""
    frames = room_frames()
    tracker, _ = _tracked(_store(), frames[:30])
    shown = with_black(frames[29]), frames[5], with_black(frames[6]), frames[6]
    results = []
    for k, frame in enumerate(shown, 1):
        stamp_ns = frames[29].stamp_ns + k * 33_000_000
        results.append(tracker.track(replace(frame, stamp_ns=stamp_ns), None))
    assert [r.status for r in results] == ["lost", "tracked", "lost", "tracked"]
    assert _is_right(results[1]) and _is_right(results[3])
    np.testing.assert_allclose(results[2].T_world_cam, results[1].T_world_cam, atol=1e-9)


def test_a_frame_of_another_place_is_lost_and_changes_nothing():
    """A view of the wrong surroundings: no alignment is believed, and tracking goes on after it."""
    store = _store()
    frames = room_frames()
    tracker, _ = _tracked(store, frames[:6])
    other = replace(
        frames[6], color=frames[6].color[::-1].copy(), depth_raw=frames[6].depth_raw[::-1].copy()
    )
    for _ in range(3):
        assert tracker.track(other, None).status == "lost"
    assert store.count == 2
    assert _is_right(tracker.track(frames[7], None))


def test_keyframes_tried_in_vain_leave_no_trace():
    """Frames that look like a keyframe but give no points end like frames that show nothing."""
    frames = room_frames()
    noise = np.random.default_rng(0).uniform(0.9, 1.1, frames[0].depth_raw.shape)
    poses = []
    for is_black in (True, False):
        tracker, _ = _tracked(_store(), frames[:34])
        for k in range(3):
            look, stamp_ns = frames[16 + k], frames[33].stamp_ns
            rough = (look.depth_raw * noise).astype(np.uint16)
            frame = replace(look, stamp_ns=stamp_ns, depth_raw=rough)
            if is_black:
                frame = with_black(frame)
            assert tracker.track(frame, None).status == "lost"
        result = tracker.track(frames[34], None)
        assert _is_right(result)
        poses.append(result.T_world_cam)
    np.testing.assert_array_equal(*poses)
