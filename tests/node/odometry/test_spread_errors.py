"""A stretch by odometry alone is bent so that it meets the frames before and after it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.odometry.spread_errors import spread_errors

_STEP = se3_exp(np.array([0.01, 0.0, 0.012, 0.0, 0.01, 0.0]))
_N, _FIRST, _LAST = 40, 10, 29  # frames; of them by odometry alone
_KNOWN = np.zeros(_N, bool)  # the path knows each motion


def _true_path() -> np.ndarray:
    return np.stack([np.linalg.matrix_power(_STEP, k) for k in range(_N)])


def _drifted(scale: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Published poses, the path of odometry and which are by it alone; each step is off by a factor [6]."""
    truth, off = _true_path(), se3_exp(scale * se3_log(_STEP))
    is_dead = (np.arange(_N) >= _FIRST) & (np.arange(_N) <= _LAST)
    odom = np.stack([np.linalg.matrix_power(off, k) for k in range(_N)])
    published = truth.copy()
    for k in range(_FIRST, _LAST + 1):
        published[k] = truth[_FIRST - 1] @ inverse(odom[_FIRST - 1]) @ odom[k]
    return published, odom, is_dead


_scale = st.lists(st.floats(0.95, 1.05), min_size=6, max_size=6).map(np.array)


@given(_scale)
def test_a_constant_error_of_scale_goes(scale):
    published, odom, is_dead = _drifted(scale)
    fitted = spread_errors(published, odom, is_dead, _KNOWN)
    truth = _true_path()
    before, after = (
        np.linalg.norm((T - truth)[:, :3, 3], axis=1).max() for T in (published, fitted)
    )
    assert after <= max(0.25 * before, 1e-9)
    np.testing.assert_array_equal(fitted[~is_dead], published[~is_dead])


def test_poses_stay_as_they_are_without_a_frame_after_them_or_without_such_poses():
    published, odom, is_dead = _drifted(np.full(6, 1.02))
    cut = slice(0, _LAST)
    np.testing.assert_array_equal(
        spread_errors(published[cut], odom[cut], is_dead[cut], _KNOWN[cut]), published[cut]
    )
    start = slice(_FIRST, None)
    np.testing.assert_array_equal(
        spread_errors(published[start], odom[start], is_dead[start], _KNOWN[start]),
        published[start],
    )
    none = np.zeros(_N, bool)
    assert spread_errors(published, odom, none, _KNOWN) is published


def test_a_camera_that_stood_still_is_spread_too():
    still = np.tile(np.eye(4), (5, 1, 1))
    published = still.copy()
    published[4, 0, 3] = 0.01
    is_dead = np.array([False, True, True, True, False])
    fitted = spread_errors(published, still, is_dead, _KNOWN[:5])
    np.testing.assert_allclose(fitted[:, 0, 3], [0.0, 0.0025, 0.005, 0.0075, 0.01], atol=1e-9)


def test_a_stretch_at_whose_end_the_camera_was_lost_stays_as_it_is():
    """The path stands still to the frame at which the camera is found, while the camera went on."""
    published, odom, is_dead = _drifted(np.full(6, 1.02))
    is_unknown = np.arange(_N) == _LAST + 1
    held = odom.copy()
    held[_LAST + 1 :] = odom[_LAST] @ inverse(odom[_LAST + 1]) @ odom[_LAST + 1 :]
    np.testing.assert_array_equal(spread_errors(published, held, is_dead, is_unknown), published)
    known = spread_errors(published, odom, is_dead, _KNOWN)
    assert np.abs(known - published).max() > 1e-3
    begun_there = np.arange(_N) == _FIRST - 1
    np.testing.assert_array_equal(spread_errors(published, odom, is_dead, begun_there), known)
