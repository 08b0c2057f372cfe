"""A sensor agrees with the camera if it moves alike, and rest, noise or a short slip are no disagreement."""

import numpy as np
import pytest

from hsslam_node.tracking.motion_agreement import MotionAgreement

_PERIOD_S = 1 / 30


def _after(seconds: float, moved_m_s: float, off_m_s: float) -> MotionAgreement:
    agreement = MotionAgreement(0.1)
    for _ in range(round(seconds / _PERIOD_S)):
        rates = np.array([moved_m_s]), np.array([off_m_s])
        agreement.compare(*(_PERIOD_S * rate for rate in rates), _PERIOD_S)
    return agreement


@pytest.mark.parametrize(
    ("moved_m_s", "off_m_s", "holds"),
    [(0.0, 0.09, True), (0.0, 0.11, False), (1.0, 0.45, True), (1.0, 0.55, False)],
)
def test_half_of_the_motion_and_the_noise_may_differ(moved_m_s, off_m_s, holds):
    agreement = _after(2.0, moved_m_s, off_m_s)
    assert agreement.is_known and agreement.holds == holds


def test_it_is_not_known_at_once_and_a_short_slip_is_forgotten():
    assert not _after(0.3, 1.0, 1.0).is_known
    agreement = _after(8.0, 1.0, 0.0)
    for rates in [(1.0, 1.0)] * 30 + [(1.0, 0.0)] * 30:  # one second of wheels that stand still
        agreement.compare(*(np.array([_PERIOD_S * rate]) for rate in rates), _PERIOD_S)
        assert agreement.holds


@pytest.mark.parametrize("when", ["first", "later"])
@pytest.mark.parametrize("seconds", [0.0, -5.0])
def test_stamps_that_repeat_or_go_back_count_for_nothing(when, seconds):
    agreement = MotionAgreement(0.1) if when == "first" else _after(2.0, 1.0, 0.0)
    agreement.compare(np.array([0.03]), np.array([0.03]), seconds)
    for _ in range(60):
        agreement.compare(np.array([_PERIOD_S]), np.array([0.0]), _PERIOD_S)
    assert agreement.is_known and agreement.holds
