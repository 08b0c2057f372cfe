"""Seconds in which the camera sees nothing."""

import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options import SourceOptions, SynthOptions

_SMALL = SynthOptions(width_px=32, height_px=32)


def test_frames_are_black_and_without_depth_in_these_seconds():
    source = open_source(
        "synth:room", SourceOptions(frames=12, dark=(0.1, 0.2, 0.3, 0.4), synth=_SMALL)
    )
    frames = [f for f in source.frames() if isinstance(f, Frame)]
    dark = [f.index for f in frames if not f.color.any() and not f.depth_raw.any()]
    assert dark == [3, 4, 5, 9, 10, 11]
    assert all(f.color.any() and f.depth_raw.any() for f in frames if f.index not in dark)


@pytest.mark.parametrize("dark", [(1.0,), (2.0, 1.0), (1.0, 2.0, 1.5, 3.0), (-1.0, 2.0)])
def test_seconds_come_in_pairs_that_rise(dark):
    with pytest.raises(UserError, match=r"^--dark .*: expected pairs of seconds that rise"):
        SourceOptions(dark=dark)
