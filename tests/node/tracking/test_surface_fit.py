from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.tracking.rendering_tracker import surface_fit
from hsslam_node.tracking.tracked_frame import frame_points
from tests.small_room import SMALL, displaced, map_view, room_frames, room_poses


def test_points_fit_at_the_true_pose_and_nowhere_else():
    view, frame, truth = map_view(), room_frames()[14], room_poses()[14]
    points = frame_points(frame, SMALL.tracker, 0)
    at_truth = surface_fit(points, truth, view, SMALL.tracker)
    assert at_truth.inlier_ratio > 0.9 and at_truth.rms_m < 0.01
    off = surface_fit(points, displaced(truth, 0.2, 5.0), view, SMALL.tracker)
    assert off.inlier_ratio < 0.5


def test_points_outside_the_bound_are_counted_and_do_not_fit():
    view, points = map_view(), frame_points(room_frames()[0], SMALL.tracker, 0)
    far = np.eye(4)
    far[:3, 3] = 100.0
    fit = surface_fit(points, far, view, SMALL.tracker)
    assert fit.outside == len(points) and fit.inlier_ratio == 0


def test_a_frame_has_points_for_the_keyframe_and_its_share_for_the_map():
    frame, c = room_frames()[0], replace(SMALL.tracker, surface_factor=1)
    few = frame_points(frame, c, 0)
    many = frame_points(frame, replace(c, surface_factor=4), 0)
    assert len(many) == pytest.approx(4 * len(few), rel=0.1)
