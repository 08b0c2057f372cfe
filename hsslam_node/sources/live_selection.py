"""Selects frames of a live camera; a file of its own, as ROS 2 and RealSense share it."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from hsslam_node.frame import Frame
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, NoFrame


def selected_live(
    items: Iterable[Frame | BadFrame], options: SourceOptions
) -> Iterator[Frame | BadFrame]:
    """Every `stride`-th after the first `start`, at most `frames`, numbered from 0; and each `NoFrame`."""
    used, number = 0, -1
    for item in items:
        if isinstance(item, NoFrame):
            yield item
            continue
        number += 1
        if number >= options.start and (number - options.start) % options.stride == 0:
            yield replace(item, index=used)
            used += 1
            if used == options.frames:
                return
