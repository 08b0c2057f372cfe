from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.depth_noise import averaging_limit
from hsslam_node.tracking.rendering_tracker import surface_fit
from hsslam_node.tracking.tracked_frame import frame_points
from tests.noisy_depth import with_white_noise
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


def test_a_frame_of_noisy_depth_has_more_points_and_one_of_exact_depth_has_not():
    exact = room_frames()[0]
    few = replace(SMALL.tracker, points=500, surface_points=0, depth_window_px=5)
    many = replace(few, surface_points=2000)
    noisy = with_white_noise(exact, 4e-3)
    counts = [len(frame_points(noisy, c, 0)) for c in (few, many)]
    assert counts[1] == pytest.approx(4 * counts[0], rel=0.2)
    np.testing.assert_array_equal(frame_points(exact, few, 0), frame_points(exact, many, 0))
    given = [frame_points(noisy, many, 0, limit) for limit in (averaging_limit(noisy, 5), 0.0)]
    np.testing.assert_array_equal(given[0], frame_points(noisy, many, 0))
    np.testing.assert_array_equal(given[1], frame_points(noisy, replace(few, depth_window_px=1), 0))
