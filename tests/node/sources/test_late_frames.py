"""Frames that are late are not rendered, whatever else is done to a source's frames."""

import pytest

from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import ReadsInTime, frames_in_time
from tests.late_frames import expect_late_frames_left_out

_SMALL = SynthOptions(width_px=64, height_px=48)


@pytest.mark.parametrize(
    "options",
    [
        SourceOptions(frames=6, synth=_SMALL),
        SourceOptions(frames=6, synth=_SMALL, noise="kinect", exposure="drift", downscale=2),
        SourceOptions(start=597, frames=9, synth=_SMALL, to_and_fro=2),
    ],
)
def test_rendered_frames(options):
    expect_late_frames_left_out(open_source("synth:room", options))


class _Plugin:
    """A source that knows nothing of late frames."""

    name, rate_hz, frame_count, depth_units_per_m = "plugin", 30.0, 3, 5000.0
    camera = open_source("synth:room", SourceOptions(frames=1, synth=_SMALL)).camera

    def frames(self, first: int = 0):
        yield from open_source("synth:room", SourceOptions(frames=3, synth=_SMALL)).frames(first)


def test_a_plugin_that_cannot_leave_out_frames_gives_them_all():
    plugin = _Plugin()
    assert not isinstance(plugin, ReadsInTime)
    found = list(frames_in_time(plugin, 1, lambda index, stamp_ns: True))
    assert [frame.index for frame in found] == [1, 2]
