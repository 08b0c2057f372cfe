"""Rate, order, gaps, jitter and association, of stamps alone."""

import numpy as np
import pytest

from hsslam_node.doctor.stamps import (
    check_association,
    check_rate,
    check_stamp_gaps,
    check_stamp_jitter,
    check_stamp_order,
)

MS = 1_000_000
STAMPS = np.round(np.arange(300) * 1e9 / 30).astype(np.int64)


def jittered(sd_ms: float, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, sd_ms, len(STAMPS)) * MS
    return STAMPS + noise.astype(np.int64)


@pytest.mark.parametrize(
    ("scale", "severity", "rate_hz"),
    [(1, "ok", 30), (3, "note", 10), (10, "fault", 3), (0.001, "fault", 30_000)],
)
def test_rate(scale, severity, rate_hz):
    found = check_rate((np.diff(STAMPS) * scale).astype(np.int64))
    assert found.severity == severity
    assert found.value == pytest.approx(rate_hz, rel=1e-3)


def test_order_counts_what_goes_back_and_what_is_there_twice():
    stamps = STAMPS.copy()
    assert check_stamp_order(np.diff(stamps), "colour").severity == "ok"
    stamps[10], stamps[50] = stamps[8], stamps[49]
    found = check_stamp_order(np.diff(stamps), "colour")
    assert (found.severity, found.value) == ("fault", 2.0)
    assert "1 of 300 stamps go back" in found.seen


def test_gaps():
    assert check_stamp_gaps(np.diff(STAMPS)).severity == "ok"
    some = np.delete(STAMPS, np.arange(5, 295, 20))
    assert check_stamp_gaps(np.diff(some)).severity == "note"
    assert check_stamp_gaps(np.diff(some)).value == pytest.approx(5, abs=0.2)
    many = np.delete(STAMPS, np.arange(2, 295, 3))
    assert check_stamp_gaps(np.diff(many)).severity == "fault"
    torn = np.delete(STAMPS, np.arange(100, 140))  # one gap of 1.4 s
    assert check_stamp_gaps(np.diff(torn)).severity == "fault"


@pytest.mark.parametrize(
    ("sd_ms", "severity"), [(0, "ok"), (0.5, "ok"), (1.5, "note"), (3, "fault"), (10, "fault")]
)
def test_jitter(sd_ms, severity):
    found = check_stamp_jitter(np.diff(np.sort(jittered(sd_ms))), "colour")
    assert found.severity == severity
    if 0 < sd_ms < 10:
        assert found.value == pytest.approx(sd_ms * np.sqrt(2), rel=0.15)


def test_dropped_frames_are_no_jitter():
    some = np.delete(STAMPS, np.arange(5, 295, 7))
    assert check_stamp_jitter(np.diff(some), "colour").severity == "ok"


@pytest.mark.parametrize(
    ("offset_ms", "severity"), [(0, "ok"), (-8, "ok"), (14, "note"), (20_000, "fault")]
)
def test_association(offset_ms, severity):
    found = check_association(STAMPS, STAMPS + offset_ms * MS, 20 * MS)
    assert found.severity == severity


def test_a_constant_offset_is_told():
    slow = STAMPS[::3]  # 10 Hz: 25 ms is the nearest
    found = check_association(slow, slow + 25 * MS, 20 * MS)
    assert (found.severity, found.value) == ("fault", 100.0)
    assert "+25.0 ms" in found.advice


def test_a_list_of_one_stamp():
    one = STAMPS[:1]
    assert check_association(one, one, 20 * MS).severity == "ok"
    assert check_rate(np.diff(one)).value is None
    assert check_stamp_gaps(np.diff(one)).value is None
    assert check_stamp_jitter(np.diff(one), "colour").value is None
