"""Frames in another order come with indices and stamps of a camera that never stopped."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.reordered import Reordered
from hsslam_node.sources.source import BadFrame
from tests.small_room import OPTIONS, room_frames


def test_the_order_is_kept_and_time_runs_on():
    source = open_source("synth:room", OPTIONS)
    order = [0, 2, 4, 3, 5, 1, 3, 39]
    reordered = Reordered(source, order)
    frames = list(reordered.frames())
    assert reordered.frame_count == len(frames) == 8
    for n, (frame, k) in enumerate(zip(frames, order, strict=True)):
        assert not isinstance(frame, BadFrame)
        assert frame.index == n and frame.stamp_ns == round(n * 1e9 / 30)
        np.testing.assert_array_equal(frame.color, room_frames()[k].color)
        np.testing.assert_array_equal(frame.depth_raw, room_frames()[k].depth_raw)


def test_a_frame_that_is_not_there_is_told():
    with pytest.raises(UserError, match="frame 40: expected one of 40"):
        Reordered(open_source("synth:room", OPTIONS), [0, 40])


def test_a_source_that_ends_early_is_told():
    class Short:
        name, rate_hz = "short", 30.0
        frame_count: int | None = None
        camera, depth_units_per_m = room_frames()[0].camera, room_frames()[0].depth_units_per_m

        def frames(self, first=0):
            yield BadFrame(0, 7, "not there")

    frames = Reordered(Short(), [0, 0, 1]).frames()
    assert next(frames) == BadFrame(0, 0, "not there")
    assert next(frames) == BadFrame(1, 33_333_333, "not there")
    with pytest.raises(UserError, match="ended before frame 1"):
        next(frames)
