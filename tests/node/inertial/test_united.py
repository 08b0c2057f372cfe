"""Samples of a gyroscope and of an accelerometer become one series, at the stamps of the gyroscope."""

import numpy as np
import pytest

from hsslam_node.inertial.united import UnitedSample, UnitedSamples

_GYROSCOPE_NS, _ACCELEROMETER_NS = 5_000_000, 16_000_000  # 200 and 62.5 Hz


def _force(stamp_ns: int) -> np.ndarray:
    return np.array([1e-9 * stamp_ns, -9.81, 2e-9 * stamp_ns])


def _turn_rate(stamp_ns: int) -> np.ndarray:
    return np.array([0.0, 1.0 * stamp_ns, 0.0])


def _united(turn_rates_ns: list[int], forces_ns: list[int], late_ns: int = 0) -> list[UnitedSample]:
    """In the order of the stamps; samples of the gyroscope come `late_ns` later."""
    samples, out = UnitedSamples(), []
    events = [(ns + late_ns, ns, True) for ns in turn_rates_ns]
    events += [(ns, ns, False) for ns in forces_ns]
    for _, ns, is_turn in sorted(events):
        if is_turn:
            out += samples.add_turn_rate(ns, _turn_rate(ns))
        else:
            out += samples.add_force(ns, _force(ns))
    return out


@pytest.mark.parametrize("late_ns", [0, 1, 40_000_000])
def test_each_turn_rate_gets_the_acceleration_at_its_stamp(late_ns: int):
    turn_rates_ns = list(range(0, 500_000_000, _GYROSCOPE_NS))
    forces_ns = list(range(7_000_000, 500_000_000, _ACCELEROMETER_NS))
    united = _united(turn_rates_ns, forces_ns, late_ns)
    expected_ns = [ns for ns in turn_rates_ns if forces_ns[0] <= ns <= forces_ns[-1]]
    assert [sample[0] for sample in united] == expected_ns
    for stamp_ns, turn_rate, force in united:
        np.testing.assert_array_equal(turn_rate, _turn_rate(stamp_ns))
        np.testing.assert_allclose(force, _force(stamp_ns), atol=1e-12)


def test_no_acceleration_is_made_up_over_a_gap():
    turn_rates_ns = list(range(0, 400_000_000, _GYROSCOPE_NS))
    united = _united(turn_rates_ns, [0, 100_000_000, 201_000_000, 300_000_000])
    stamps_ns = [sample[0] for sample in united]
    assert stamps_ns == [ns for ns in turn_rates_ns[:61] if ns <= 100_000_000 or ns > 201_000_000]


def test_a_clock_that_is_set_back_begins_anew():
    samples = UnitedSamples()
    samples.add_force(9 * 10**9, _force(900))
    samples.add_turn_rate(9 * 10**9 + 50, _turn_rate(950))
    assert not samples.add_turn_rate(50, _turn_rate(50))  # before any acceleration of the new time
    assert not samples.add_force(100, _force(100))
    assert not samples.add_turn_rate(150, _turn_rate(150))
    ((stamp_ns, _, force),) = samples.add_force(200, _force(200))
    assert stamp_ns == 150
    np.testing.assert_allclose(force, _force(150), atol=1e-12)


def test_a_sample_out_of_order_is_left_out_alone():
    samples = UnitedSamples()
    samples.add_force(0, _force(0))
    for stamp_ns in (10, 20, 15, 30):
        assert not samples.add_turn_rate(stamp_ns, _turn_rate(stamp_ns))
    assert [sample[0] for sample in samples.add_force(40, _force(40))] == [10, 20, 30]
