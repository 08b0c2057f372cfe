"""Which frames of a live camera are used."""

from hsslam_node.sources.live_selection import selected_live
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, NoFrame


def test_start_stride_and_limit():
    taken = []

    def live():
        for k in range(100):
            taken.append(k)
            yield BadFrame(0, k, "")

    options = SourceOptions(start=3, stride=4, frames=3)
    assert [(i.index, i.stamp_ns) for i in selected_live(live(), options)] == [
        (0, 3),
        (1, 7),
        (2, 11),
    ]
    assert taken == list(range(12))  # does not wait for what it does not need
    everything = selected_live(live(), SourceOptions())
    assert [item.index for item in everything] == list(range(100))


def test_silence_is_told_and_is_no_frame():
    heard = [BadFrame(0, 0, ""), NoFrame(0, 1, "quiet"), BadFrame(0, 2, ""), BadFrame(0, 3, "")]
    chosen = selected_live(heard, SourceOptions(stride=2))
    assert [(item.index, item.stamp_ns) for item in chosen] == [(0, 0), (0, 1), (1, 3)]
