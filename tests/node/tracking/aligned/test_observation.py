"""A frame prepared for tracking."""

from dataclasses import replace

import pytest

from hsslam_node.frame import Frame
from hsslam_node.tracking.aligned.observation import Observation
from tests.noisy_depth import with_white_noise
from tests.small_room import SMALL, room_frames

_CONFIG = replace(SMALL.tracker, points=500, surface_points=2000, depth_window_px=5)


def _noisy(share: float) -> Frame:
    """A frame with independent noise, and depth in this share of its columns."""
    frame = with_white_noise(room_frames()[0], 4e-3)
    raw = frame.depth_raw.copy()
    raw[:, int(share * raw.shape[1]) :] = 0
    return replace(frame, depth_raw=raw)


@pytest.mark.parametrize(("share", "has_depth"), [(1.0, True), (0.5, True), (0.12, False)])
def test_more_points_do_not_make_a_covered_lens_one_that_sees(share, has_depth):
    frame = _noisy(share)
    limit = Observation.of(_noisy(1.0), None, _CONFIG, 0, localise_only=False).fewest_points
    assert limit == 400
    averaged = Observation.of(frame, None, _CONFIG, 0, localise_only=False, averaging=8e-3)
    measured = Observation.of(frame, None, _CONFIG, 0, localise_only=False, averaging=0.0)
    assert len(averaged.points) > 3 * len(measured.points)
    assert averaged.has_depth == measured.has_depth == has_depth


def test_few_points_are_enough_for_a_frame_with_holes_if_few_are_asked_for():
    few = replace(_CONFIG, points=100)
    for averaging in (0.0, 8e-3):
        seen = Observation.of(_noisy(0.6), None, few, 0, localise_only=False, averaging=averaging)
        assert seen.has_depth
