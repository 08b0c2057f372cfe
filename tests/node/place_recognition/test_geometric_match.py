"""Features find the pose among wrong matches, and find none where all are wrong."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.place_recognition.geometric_match import (
    agreeing_pose,
    geometric_match,
    mutual_matches,
)
from hsslam_node.place_recognition.image_features import ImageFeatures, image_features
from tests.small_room import pose_error, room_frames, room_poses, with_black

CAMERA = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)


def _features(points: np.ndarray, seed: int) -> ImageFeatures:
    """Points [N, 3] m as an image shows them, with random descriptors."""
    x, y, z = points.T
    pixels = np.stack([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy], axis=-1)
    descriptors = np.random.default_rng(seed).integers(0, 40, (len(points), 128)).astype(np.uint8)
    return ImageFeatures(pixels, points, descriptors)


def _points(rng: np.random.Generator, n: int) -> np.ndarray:
    """Points [n, 3] m in view, 1 to 4 m away."""
    z = rng.uniform(1.0, 4.0, n)
    u, v = rng.uniform(0, 640, n), rng.uniform(0, 480, n)
    return np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], -1)


def _noisy_view(
    points: np.ndarray, T_cam_keyframe: np.ndarray, rng: np.random.Generator
) -> ImageFeatures:
    """The points from elsewhere, half a pixel and half a per cent of depth off."""
    seen = points @ T_cam_keyframe[:3, :3].T + T_cam_keyframe[:3, 3]
    seen[:, :2] += rng.normal(0, 0.5, (len(points), 2)) * seen[:, 2:] / CAMERA.fx
    exact = _features(seen, 0)
    depth = seen * (1 + rng.normal(0, 0.005, (len(points), 1)))
    return ImageFeatures(exact.pixels, depth, exact.descriptors)


@given(
    twist=st.lists(st.floats(-0.4, 0.4), min_size=6, max_size=6),
    seed=st.integers(0, 2**31 - 1),
)
def test_the_pose_is_recovered_with_half_of_the_matches_wrong(twist, seed):
    rng = np.random.default_rng(seed)
    points = _points(rng, 80)
    T_cam_keyframe = se3_exp(np.array(twist))
    keyframe, cam = _features(points, 0), _noisy_view(points, T_cam_keyframe, rng)
    rows = np.arange(80)
    is_wrong = rng.permutation(80) < 40
    other = rows.copy()
    other[is_wrong] = rng.permutation(other[is_wrong])
    found = agreeing_pose(cam, keyframe, np.stack([rows, other], axis=-1), CAMERA)
    assert found is not None
    distance_m, angle_deg = pose_error(found.T_keyframe_cam, inverse(T_cam_keyframe))
    assert distance_m < 0.03 and angle_deg < 0.6
    assert len(found.inliers) >= 36 and found.matches == 80
    right = found.inliers[:, 0] == found.inliers[:, 1]
    assert right.mean() > 0.95


@given(seed=st.integers(0, 2**31 - 1))
def test_random_matches_give_no_pose(seed):
    rng = np.random.default_rng(seed)
    cam, keyframe = _features(_points(rng, 80), 0), _features(_points(rng, 80), 1)
    pairs = np.stack([np.arange(80), rng.permutation(80)], axis=-1)
    assert agreeing_pose(cam, keyframe, pairs, CAMERA) is None


def test_the_same_matches_give_the_same_pose_to_the_bit():
    frames = room_frames()
    features = image_features(frames[20]), image_features(frames[0])
    first, second = (geometric_match(*features, frames[0].camera) for _ in range(2))
    assert first is not None and second is not None
    np.testing.assert_array_equal(first.T_keyframe_cam, second.T_keyframe_cam)


@pytest.mark.parametrize("apart", [5, 20])
def test_two_views_of_the_room(apart):
    frames, poses = room_frames(), room_poses()
    features = image_features(frames[apart]), image_features(frames[0])
    found = geometric_match(*features, frames[0].camera)
    assert found is not None and len(found.inliers) >= 20
    distance_m, angle_deg = pose_error(found.T_keyframe_cam, inverse(poses[0]) @ poses[apart])
    assert distance_m < 0.05 and angle_deg < 1.0


def test_nothing_in_view_matches_nothing():
    frame = room_frames()[0]
    some, none = image_features(frame), image_features(with_black(frame))
    assert len(mutual_matches(some, none)) == len(mutual_matches(none, some)) == 0
    assert geometric_match(none, some, frame.camera) is None
