"""A body that walks."""

import numpy as np

from hsslam_node.synth.scenes.person import Person

_PERSON = Person((4.0, 2.0), (1.0, 2.0), 0.75)


def _bounds_m(frame: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = [], []
    for part in _PERSON.at(frame):
        reach = np.sqrt(((part.rotation * part.half_m) ** 2).sum(1))  # of an ellipsoid
        low.append(part.center_m - reach)
        high.append(part.center_m + reach)
    return np.min(low, axis=0), np.max(high, axis=0)


def test_he_has_the_size_of_a_man_and_stays_on_the_floor():
    for frame in range(0, 330, 11):
        low, high = _bounds_m(frame)
        assert 1.65 < high[2] < 1.85
        assert -0.05 < low[2] < 0.06
        assert (high - low)[:2].max() < 1.2


def test_he_walks_to_and_fro_at_his_pace_without_jumps():
    chest = np.array([_PERSON.at(k)[2].center_m for k in range(700)])
    steps_m = np.linalg.norm(np.diff(chest, axis=0), axis=1)
    assert steps_m.max() < 0.05
    assert abs(np.median(steps_m) - 0.025) < 0.003
    assert chest[:, 0].min() < 1.1 and chest[:, 0].max() > 3.9
    crossings = np.flatnonzero(np.diff(np.sign(chest[:, 0] - 2.5)))
    assert len(crossings) >= 4


def test_no_part_jumps_and_limbs_swing():
    shin = np.array([_PERSON.at(k)[9].center_m - _PERSON.at(k)[2].center_m for k in range(300)])
    assert np.linalg.norm(np.diff(shin, axis=0), axis=1).max() < 0.12
    assert np.ptp(shin[:90, 0]) > 0.3  # walks along x
    parts = [[p.rotation for p in _PERSON.at(k)] for k in range(300)]
    turns = np.abs(np.diff(np.array(parts), axis=0)).max()
    assert turns < 0.25


def test_the_same_frame_is_the_same_pose():
    one, again = _PERSON.at(77), _PERSON.at(77)
    assert all(np.array_equal(a.rotation, b.rotation) for a, b in zip(one, again, strict=True))
    assert all(np.array_equal(a.half_m, b.half_m) for a, b in zip(one, _PERSON.at(5), strict=True))
