import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.rendering.ray_sampling import SamplingPattern, sample_rays

PAPER = SamplingPattern()


def test_samples_are_sorted_and_within_reach():
    depth = np.array([1.0, 2.5, 0.03], np.float32)
    z = sample_rays(depth, PAPER, 0.06, 5.0, np.random.default_rng(0))
    assert z.shape == (3, 40) and z.dtype == np.float32
    assert (np.diff(z, axis=1) >= 0).all() and (z >= 0).all()
    assert (z <= np.maximum(1.2 * depth, depth + 0.09)[:, None] + 1e-6).all()


def test_each_stratum_has_one_sample_and_the_surface_its_own():
    z = sample_rays(np.array([2.0]), PAPER, 0.06, 5.0, np.random.default_rng(1))[0]
    near = np.abs(z - 2.0) <= 0.09 + 1e-6
    assert near.sum() >= 8
    free = sample_rays(
        np.array([2.0]), SamplingPattern(32, 0), 0.06, 5.0, np.random.default_rng(1)
    )[0]
    np.testing.assert_array_equal((free / (2.4 / 32)).astype(int), np.arange(32))


def test_a_ray_without_depth_is_sampled_to_the_far_end():
    z = sample_rays(np.array([0.0]), PAPER, 0.06, 4.0, None)[0]
    np.testing.assert_allclose(z, (np.arange(40) + 0.5) / 40 * 4.0, rtol=1e-6)


def test_same_generator_same_samples():
    a, b = (sample_rays(np.ones(7), PAPER, 0.06, 4.0, np.random.default_rng(2)) for _ in range(2))
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("bad", [(0, 0), (-1, 4)])
def test_pattern_without_samples_is_refused(bad):
    with pytest.raises(UserError, match="sampling"):
        SamplingPattern(*bad)
