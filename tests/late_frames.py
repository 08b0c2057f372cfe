"""What every recording does with frames that are late; shared by the tests of all of them."""

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.sources.source import LateFrame, Source, frames_in_time


def expect_late_frames_left_out(source: Source) -> None:
    """Every second frame is late: it is not decoded, and the others are as they are without."""
    all_frames = list(source.frames())
    late_ns = {frame.stamp_ns for frame in all_frames[1::2]}
    asked: list[tuple[int, int]] = []

    def is_late(index: int, stamp_ns: int) -> bool:
        asked.append((index, stamp_ns))
        return stamp_ns in late_ns

    found = list(frames_in_time(source, 1, is_late))
    assert asked == [(frame.index, frame.stamp_ns) for frame in all_frames[1:]]
    assert len(found) == len(all_frames) - 1 > 1
    for item, frame in zip(found, all_frames[1:], strict=True):
        assert (item.index, item.stamp_ns) == (frame.index, frame.stamp_ns)
        if item.stamp_ns in late_ns:
            assert isinstance(item, LateFrame)
        else:
            assert isinstance(item, Frame) and isinstance(frame, Frame)
            np.testing.assert_array_equal(item.color, frame.color)
            np.testing.assert_array_equal(item.depth_raw, frame.depth_raw)
