"""The Kinect noise model."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.sources.effects.kinect_noise import KinectNoise, add_kinect_noise
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.replica import ReplicaSource


def wall(depth_m: float) -> np.ndarray:
    return np.full((240, 320), round(depth_m * 5000), np.uint16)


@pytest.mark.parametrize("depth_m", [0.8, 1.5, 3.0, 5.0])
def test_the_spread_is_the_published_one(depth_m):
    noisy = add_kinect_noise(wall(depth_m), 5000, 0, 0) / 5000
    step_m = depth_m**2 / 43.5 / 8
    expected = np.hypot(1.425e-3 * depth_m**2, step_m / np.sqrt(12))
    assert noisy.std() == pytest.approx(expected, rel=0.15)
    assert noisy.mean() == pytest.approx(depth_m, abs=0.1 * step_m + 1e-3)


def test_disparities_are_eighths_of_a_pixel():
    noisy = add_kinect_noise(wall(1.0), 5000, 0, 0)
    eighths = 8 * 43.5 * 5000 / noisy.astype(float)
    assert np.abs(eighths - np.rint(eighths)).max() < 0.1


def test_nothing_beyond_six_metres_and_no_depth_out_of_nothing():
    assert not add_kinect_noise(wall(6.5), 5000, 0, 0).any()
    assert not add_kinect_noise(np.zeros((48, 64), np.uint16), 5000, 0, 0).any()


def test_the_jitter_moves_edges_by_about_half_a_pixel():
    step = np.where(np.arange(320) < 160, 5000, 10000).astype(np.uint16)[None].repeat(240, axis=0)
    near = add_kinect_noise(step, 5000, 0, 0) < 7500
    first_far = (near[:, 150:170]).sum(axis=1)
    assert first_far.mean() == pytest.approx(10, abs=0.1)
    assert (near[:, 159] == 0).mean() == pytest.approx(0.16, abs=0.05)  # P(jitter > 0.5 px)


@given(st.integers(0, 2**31 - 1), st.integers(0, 10_000))
def test_a_frame_depends_on_seed_and_index_only(seed, index):
    depth = wall(2.0)[:24, :32]
    once, again = (add_kinect_noise(depth, 5000, seed, index) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert (add_kinect_noise(depth, 5000, seed, index + 1) != once).any()


def test_wraps_a_source_and_leaves_the_rest_alone(replica_folder):
    clean = ReplicaSource(str(replica_folder), SourceOptions())
    noisy = KinectNoise(clean, seed=3)
    for a, b in zip(clean.frames(), noisy.frames(), strict=True):
        assert (a.index, a.stamp_ns, a.camera) == (b.index, b.stamp_ns, b.camera)
        np.testing.assert_array_equal(a.color, b.color)
