"""A fault that lasts is reported at once, then every few seconds with a count."""

from collections.abc import Callable, Iterable

import pytest
from pytest import MonkeyPatch

from hsslam_node.sources import skipped_frames
from hsslam_node.sources.skipped_frames import SkippedFrames
from hsslam_node.sources.source import BadFrame


@pytest.fixture
def skip(monkeypatch: MonkeyPatch) -> Callable[[Iterable[str]], tuple[SkippedFrames, list[str]]]:
    """Skips a frame for each reason, at 30 Hz; returns the counter, and the lines that it reports."""
    now_s = [100.0]
    monkeypatch.setattr(skipped_frames.time, "monotonic", lambda: now_s[0])

    def skip(reasons: Iterable[str]) -> tuple[SkippedFrames, list[str]]:
        told: list[str] = []
        skipped = SkippedFrames(told.append)
        for index, reason in enumerate(reasons):
            now_s[0] += 1 / 30
            skipped.add(BadFrame(index, 0, reason))
        return skipped, told

    return skip


def test_one_reason_is_one_event_and_counts(skip):
    skipped, told = skip(300 * ["rgb8 of 160x120 pixels"])  # 10 s
    assert told[0] == "frame 0 skipped: rgb8 of 160x120 pixels"
    assert len(told) == 2 and told[1] == "150 more skipped: rgb8 of 160x120 pixels"
    skipped.add(BadFrame(300, 0, "another"))
    skipped.report_more()
    assert told[2:] == [
        "frame 300 skipped: another",
        "149 more skipped: rgb8 of 160x120 pixels",
    ]


def test_reasons_that_alternate_are_reported_and_counted_apart(skip):
    _, told = skip(150 * ["color: no stamp", "depth: no stamp"])  # 10 s
    assert told == [
        "frame 0 skipped: color: no stamp",
        "frame 1 skipped: depth: no stamp",
        "75 more skipped: color: no stamp",
        "74 more skipped: depth: no stamp",
    ]


def test_reasons_that_never_repeat_are_counted_together(skip):
    skipped, told = skip(f"{index} bytes" for index in range(140))
    assert told == [f"frame {index} skipped: {index} bytes" for index in range(4)]
    skipped.report_more()
    assert told[4:] == ["136 more skipped for other reasons"]


def test_a_reason_is_one_line_of_bounded_length():
    told: list[str] = []
    SkippedFrames(told.append).add(BadFrame(7, 0, "first\nsecond " + 1000 * "x"))
    assert told[0].startswith("frame 7 skipped: first second xxx") and len(told[0]) < 330
