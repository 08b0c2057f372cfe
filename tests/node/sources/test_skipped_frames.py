"""A fault that lasts is reported at once, then every few seconds with a count."""

from pytest import MonkeyPatch

from hsslam_node.sources import skipped_frames
from hsslam_node.sources.skipped_frames import SkippedFrames
from hsslam_node.sources.source import BadFrame


def test_one_reason_is_one_event_and_counts(monkeypatch: MonkeyPatch):
    now_s = [100.0]
    monkeypatch.setattr(skipped_frames.time, "monotonic", lambda: now_s[0])
    told: list[str] = []
    skipped = SkippedFrames(told.append)
    for index in range(300):  # 10 s
        now_s[0] += 1 / 30
        skipped.add(BadFrame(index, 0, "rgb8 of 160x120 pixels"))
    assert told[0] == "frame 0 skipped: rgb8 of 160x120 pixels"
    assert len(told) == 2 and told[1] == "151 more skipped: rgb8 of 160x120 pixels"
    skipped.add(BadFrame(300, 0, "another"))
    assert told[2:] == [
        "148 more skipped: rgb8 of 160x120 pixels",
        "frame 300 skipped: another",
    ]
    skipped.report_more()
    assert len(told) == 4


def test_a_reason_is_one_line_of_bounded_length():
    told: list[str] = []
    SkippedFrames(told.append).add(BadFrame(7, 0, "first\nsecond " + 1000 * "x"))
    assert told[0].startswith("frame 7 skipped: first second xxx") and len(told[0]) < 330
