import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.observed_space import ObservedSpace

CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
BOUND = Bound((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))


def _wall(depth_m):
    return np.full((48, 64), depth_m, np.float32)


def _observed_depths(space):
    """z range of all observed cells, m."""
    z = [
        space.vertex_positions(b, np.argwhere(space.cells(b)))[:, 2]
        for b in space.occupied_blocks()
        if space.cells(b).any()
    ]
    z = np.concatenate(z)
    return z.min(), z.max() + space.voxel_m


def test_cells_lie_within_a_voxel_and_a_half_of_the_surface():
    space = ObservedSpace(BOUND, 0.03, 16)
    space.observe(_wall(1.0), CAMERA, np.eye(4), stride_px=1)
    low, high = _observed_depths(space)
    assert 1.0 - 0.046 <= low <= 0.985 and 1.015 <= high <= 1.0 + 0.046


def test_gaps_between_sparse_pixels_close():
    space = ObservedSpace(BOUND, 0.03, 64)
    space.observe(_wall(1.5), CAMERA, np.eye(4), stride_px=3)  # 9 cm apart
    layer = space.cells((0, 0, 0))[:, :, 50]
    rows, columns = np.where(layer)
    patch = layer[rows.min() + 4 : rows.max() - 3, columns.min() + 4 : columns.max() - 3]
    assert patch.size > 100 and patch.all()


def test_pixels_without_depth_and_points_outside_mark_nothing():
    space = ObservedSpace(BOUND, 0.03)
    depth = _wall(5.0)
    depth[:24] = 0.0
    depth[0] = np.nan
    space.observe(depth, CAMERA, np.eye(4), 1)
    assert space.occupied_blocks() == []


def test_only_touched_blocks_are_occupied():
    space = ObservedSpace(BOUND, 0.03, 8)
    space.observe(_wall(0.5), CAMERA, np.eye(4), 1)
    assert {b[2] for b in space.occupied_blocks()} == {1, 2}  # 0.5 m is cell 16.7


def test_every_block_with_cells_is_occupied():
    space = ObservedSpace(BOUND, 0.04, 8)
    rng = np.random.default_rng(0)
    space.observe(rng.uniform(0.3, 1.9, (48, 64)).astype(np.float32), CAMERA, np.eye(4), 1)
    occupied = set(space.occupied_blocks())
    assert {b for b in np.ndindex(*space.block_count) if space.cells(b).any()} <= occupied


def test_neighbouring_blocks_agree_on_the_whole_grid():
    depth = np.random.default_rng(0).uniform(0.3, 1.9, (48, 64)).astype(np.float32)
    whole, parts = ObservedSpace(BOUND, 0.04, 50), ObservedSpace(BOUND, 0.04, 25)
    for space in (whole, parts):
        space.observe(depth, CAMERA, np.eye(4), 1)
    expected = whole.cells((0, 0, 0))
    for i, j, k in np.ndindex(2, 2, 2):
        part = expected[25 * i : 25 * i + 25, 25 * j : 25 * j + 25, 25 * k : 25 * k + 25]
        np.testing.assert_array_equal(parts.cells((i, j, k)), part)


def test_no_cell_leaves_the_bound():
    bound = Bound((-0.5, -0.5, 0.0), (0.53, 0.5, 1.01))
    space = ObservedSpace(bound, 0.03, 16)
    space.observe(_wall(1.0), CAMERA, np.eye(4), 1)
    for block in space.occupied_blocks():
        corners = space.vertex_positions(block, np.argwhere(space.cells(block)) + 1)
        assert bound.contains(corners - 1e-5).all()


def test_voxel_must_have_a_size():
    with pytest.raises(UserError, match="voxel_m"):
        ObservedSpace(BOUND, 0.0)
