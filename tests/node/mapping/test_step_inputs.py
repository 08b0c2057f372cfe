from dataclasses import replace

import numpy as np
import pytest
import torch

from hsslam_node.geometry.bound import Bound
from hsslam_node.mapping.step_inputs import (
    patch_windows,
    random_patches,
    smoothness_cube,
    window_rays,
    window_weights,
)
from hsslam_node.presets import REALTIME


def test_patches_are_the_largest_square_without_repetition():
    patches = torch.from_numpy(random_patches(700, 3, np.random.default_rng(0)))
    assert patches.shape == (3, 26, 26)
    for patch in patches:
        assert len(patch.unique()) == 26 * 26 and int(patch.max()) < 700


def test_windows_tile_the_patch_with_the_stride():
    patch = torch.arange(49).reshape(1, 7, 7)
    rays = window_rays(patch, 3, 4)
    assert rays.shape == (4, 9)
    assert rays[1].tolist() == [4, 5, 6, 11, 12, 13, 18, 19, 20]
    assert float(window_weights(3).sum()) == pytest.approx(1.0)


def test_cube_is_regular_and_inside():
    bound = Bound((-1.0, 0.0, 2.0), (3.0, 2.0, 2.5))
    cube = smoothness_cube(bound, 8, 0.1, np.random.default_rng(0))
    assert cube.shape == (8, 8, 8, 3)
    assert bound.contains(cube.reshape(-1, 3)).all()
    np.testing.assert_allclose(np.diff(cube[:, 0, 0, 0]), 0.1, rtol=1e-4)
    np.testing.assert_allclose(np.diff(cube[0, :, 0, 1]), 0.1, rtol=1e-4)


def test_patches_that_are_smaller_than_a_window_have_none():
    """As if few cores are left: an iteration then has a third of the rays."""
    config = replace(REALTIME.mapper, patch_kernel_px=20)
    for rays, windows in ((896, 36), (296, 0), (100, 0)):
        found = patch_windows(rays, config, np.random.default_rng(0))
        assert found.shape == (windows, 400)
