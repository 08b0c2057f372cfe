"""What a finding must say."""

import pytest

from hsslam_node.doctor.finding import Finding


def test_a_fault_says_what_was_expected_and_what_to_do():
    with pytest.raises(ValueError, match="rate"):
        Finding("rate", "fault", 1.0, "Hz", "slow", "15 Hz")
    assert Finding("rate", "fault", 1.0, "Hz", "slow", "15 Hz", "record faster").severity == "fault"


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_measurement_is_finite_or_none(value):
    with pytest.raises(ValueError, match="finite"):
        Finding("rate", "ok", value, "Hz", "fast", "15 Hz")
    assert Finding("rate", "ok", None, "Hz", "unknown", "15 Hz").value is None
