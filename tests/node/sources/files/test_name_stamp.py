"""Times in the names of image files."""

from datetime import UTC, datetime
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.sources.files.name_stamp import (
    name_stamp_ns,
    numbered_stamp_ns,
    unpadded_stamps_ns,
)

_SECOND = int(datetime(2024, 1, 31, 12, 30, 55, tzinfo=UTC).timestamp()) * 1_000_000_000


@pytest.mark.parametrize(
    ("stem", "stamp_ns"),
    [
        ("1305031102.175304", 1_305_031_102_175_304_000),
        ("rgb_1700000000_123456789", 1_700_000_000_123_456_789),
        ("rgb_1700000000-012345", 1_700_000_000_012_345_000),
        ("1700000000_1234", None),
        ("1700000000123", 1_700_000_000_123_000_000),
        ("frame_0007_12.5", 12_500_000_000),
        ("1700000000033.333", 1_700_000_000_033_333_000),
        ("cap_Color_1700000000033.33300781250000", 1_700_000_000_033_333_007),
        ("1700000000033333.5", 1_700_000_000_033_333_500),
        ("1700000000033333444.5", 1_700_000_000_033_333_444),
        ("17000000000333334445.5", None),
        ("1700000000033333333_cam0", 1_700_000_000_033_333_333),
        ("1700000000.033333_640x480", 1_700_000_000_033_333_000),
        ("cam0_1700000000033_rgb8", 1_700_000_000_033_000_000),
        ("1700000000033_1700000000066", 1_700_000_000_066_000_000),
        ("room1.0001", None),
        ("rgb1305031102.5", 1_305_031_102_500_000_000),
        ("2024-01-31_12-30-55.250", _SECOND + 250_000_000),
        ("cam0-20240131T123055.000001", _SECOND + 1000),
        ("2024-01-31 12:30:55.5_left", _SECOND + 500_000_000),
        ("20240131_123055_040", _SECOND + 40_000_000),
        ("2024-13-31_12-30-55.250", None),
        ("20240131_123055", None),
        ("frame000123", None),
        ("left", None),
    ],
)
def test_the_time_of_a_name(stem: str, stamp_ns: int | None):
    assert name_stamp_ns(stem) == stamp_ns


def test_a_recording_over_a_full_minute_stays_in_order():
    names = [f"2024-01-31_12-30-{s:02d}.{ms}00" for s in range(57, 60) for ms in range(10)]
    names += [f"2024-01-31_12-31-{s:02d}.{ms}00" for s in range(3) for ms in range(10)]
    stamps = [name_stamp_ns(name) for name in names]
    assert [b - a for a, b in pairwise(stamps)] == [100_000_000] * 59


@given(st.integers(0, 2**63 * 30 // 10**9 - 1000))
def test_a_number_gives_the_time_of_its_frame(number: int):
    assert (
        abs(numbered_stamp_ns(number, 30.0) * 30 - number * 10**9) <= 30 * 1024
    )  # a float64 near 2^63


@pytest.mark.parametrize("number", [276_701_161_106, 1403636579763555580, 10**40])
def test_a_number_that_is_a_time_is_named(number: int):
    with pytest.raises(
        UserError, match=rf"frame number {number} in a file name: expected at most 2767011611\d\d;"
    ):
        numbered_stamp_ns(number, 30.0)


def test_nanoseconds_without_leading_zeros_are_known_by_all_names_together():
    names = ["rgb_1700000000_600000", "rgb_1700000000_67266667", "rgb_1700000000_133933333"]
    second = 1_700_000_000 * 1_000_000_000
    found = [second + 600_000, second + 67_266_667, second + 133_933_333]
    assert unpadded_stamps_ns(names) == found
    assert unpadded_stamps_ns(names[:1]) is None  # may be microseconds
    assert unpadded_stamps_ns([*names, "rgb_1700000000_060000000"]) is None
    assert unpadded_stamps_ns([*names, "rgb_5"]) is None
