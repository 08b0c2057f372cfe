import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp
from tests.node.distance.conftest import wall


def _states_along_z(space, x=0.0, y=0.0):
    """States of the voxels on a line along z, and their middles."""
    i, j, _ = space.grid.indices(np.array([[x, y, 0.0]]))[0]
    line = space.states()[i, j]
    return line, space.grid.centres(np.array([[i, j, k] for k in range(len(line))]))[:, 2]


def test_nothing_is_known_at_first(space):
    assert (space.states() == UNKNOWN).all()


def test_in_front_of_a_wall_is_free_and_behind_it_unknown(space, camera):
    for _ in range(2):
        space.observe(wall(2.02), camera, np.eye(4))
    states, z = _states_along_z(space)
    assert (states[(z > 0.15) & (z < 1.9)] == FREE).all()
    assert states[(z > 2.0) & (z < 2.05)] == [OCCUPIED]
    assert (states[z > 2.1] == UNKNOWN).all()
    assert (states[z < 0.05] == UNKNOWN).all()


def test_outside_the_image_nothing_is_learnt(space, camera):
    space.observe(wall(2.0), camera, np.eye(4))
    centres = space.grid.centres(np.argwhere(space.states() != UNKNOWN))
    u = centres[:, 0] / centres[:, 2] * 160 + 79.5
    v = centres[:, 1] / centres[:, 2] * 160 + 59.5
    assert (u > -1).all() and (u < 160).all() and (v > -1).all() and (v < 120).all()
    assert len(centres) > 5000


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_the_place_of_the_surface_is_finer_than_a_voxel(space, camera, noise_m):
    for seed in range(20):
        space.observe(wall(2.037, noise_m, seed), camera, np.eye(4))
    indices = np.argwhere(space.states() == OCCUPIED)
    k = indices[:, 2]
    record = space.surfaces()[:, *indices.T]
    z = space.grid.centres(indices)[:, 2] + record[2] / 100 * 0.05
    assert (k == 50).mean() > 0.6 and np.isin(k, [50, 51]).all()  # it lies 1.3 cm before the next
    assert np.median(np.abs(z - 2.037)) < 0.004 and np.abs(z - 2.037).max() < 0.03
    assert (record[6] < -110).all()  # the normal looks at the camera, along -z


def test_one_noisy_pixel_is_no_obstacle(space, camera):
    depth = wall(2.5)
    depth[60, 80] = 1.0
    for _ in range(10):
        space.observe(depth, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert not (states[z < 2.4] == OCCUPIED).any()


def test_a_thin_pole_stays_while_the_wall_behind_it_is_seen(space, camera):
    depth = wall(2.5)
    depth[:, 78:81] = 1.22  # 2.3 cm wide
    for _ in range(10):
        space.observe(depth, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert states[(z > 1.2) & (z < 1.25)] == [OCCUPIED]


def test_a_flying_pixel_between_two_surfaces_neither_hits_nor_clears(space, camera):
    depth = wall(2.5)
    depth[:, :80] = 1.0
    depth[::3, 80] = 1.7  # a third of the edge
    for _ in range(10):
        space.observe(depth, camera, np.eye(4))
    middles = space.grid.centres(np.argwhere(space.states() == OCCUPIED))[:, 2]
    assert ((np.abs(middles - 1.0) < 0.06) | (np.abs(middles - 2.5) < 0.06)).all()
    behind, z = _states_along_z(space, x=-0.1)
    assert (behind[z > 1.1] == UNKNOWN).all()


def test_in_front_of_an_edge_is_free(space, camera):
    depth = wall(2.5)
    depth[:, :80] = 2.0
    depth[::3, 80] = 2.2
    space.observe(depth, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert (states[(z > 0.15) & (z < 1.5)] == FREE).all()
    assert (states[(z > 1.7) & (z < 1.9)] == UNKNOWN).all()


def test_what_is_carried_away_is_free_within_ten_images(space, camera):
    with_chair = wall(2.5)
    with_chair[40:80, 60:100] = 1.5
    for _ in range(100):
        space.observe(with_chair, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert OCCUPIED in states[np.abs(z - 1.5) < 0.06]
    for _ in range(10):
        space.observe(wall(2.5), camera, np.eye(4))
    states, z = _states_along_z(space)
    assert (states[(z > 0.15) & (z < 2.4)] == FREE).all()


def test_what_is_put_there_is_occupied_after_a_few_images(space, camera):
    for _ in range(100):
        space.observe(wall(2.5), camera, np.eye(4))
    with_chair = wall(2.5)
    with_chair[40:80, 60:100] = 1.52
    for _ in range(4):
        space.observe(with_chair, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert states[(z > 1.5) & (z < 1.55)] == [OCCUPIED]


def test_pixels_without_depth_clear_nothing(space, camera):
    for _ in range(3):
        space.observe(wall(1.52), camera, np.eye(4))
    depth = wall(2.5)
    depth[30:90, 40:120] = 0.0
    depth[31, 60] = np.nan
    depth[40:80, 50:100] = 65.535  # as some cameras write that they measured nothing
    for _ in range(20):
        space.observe(depth, camera, np.eye(4))
    states, z = _states_along_z(space)
    assert states[(z > 1.5) & (z < 1.55)] == [OCCUPIED]


def test_a_measurement_beyond_reach_frees_the_way_up_to_there(camera):
    space = Occupancy(VoxelGrid(0.05, (-30, -30, -10), (60, 60, 80)), far_m=2.0)
    for _ in range(3):
        space.observe(wall(3.0), camera, np.eye(4))
    states, z = _states_along_z(space)
    assert (states[(z > 0.15) & (z < 1.95)] == FREE).all()
    assert (states[z > 2.05] == UNKNOWN).all()


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
@settings(max_examples=20)
def test_the_frame_of_the_grid_does_not_matter(twist):
    """A camera and a grid that move together see the same."""
    T = se3_exp(np.array(twist))
    camera = Camera(80, 60, 80.0, 80.0, 39.5, 29.5)
    grid = VoxelGrid(0.1, (-15, -15, -5), (30, 30, 40))
    fixed, moved = Occupancy(grid), Occupancy(grid, T)
    depth = wall(2.02)[::2, ::2]
    for _ in range(2):
        fixed.observe(depth, camera, np.eye(4))
        moved.observe(depth, camera, np.linalg.inv(T))
    assert (fixed.states() != moved.states()).mean() < 2e-3  # voxels on a border of the image


@pytest.mark.parametrize("centre", [(1.0, 0.0, 0.0), (0.6, -0.5, 3.0), (100.0, 0.0, 0.0)])
def test_a_window_that_moves_keeps_what_it_holds(space, camera, centre):
    space.observe(wall(2.0), camera, np.eye(4))
    before, old = space.states(), space.grid
    assert space.move_to(np.array(centre))
    middle = (space.grid.low + space.grid.high) / 2
    assert (np.abs(middle - centre) < 0.3).all()
    after = space.states()
    indices = np.argwhere(np.ones(space.grid.shape, bool))
    source = old.indices(space.grid.centres(indices))
    held = old.holds(source)
    assert (after[tuple(indices[held].T)] == before[tuple(source[held].T)]).all()
    assert (after[tuple(indices[~held].T)] == UNKNOWN).all()


def test_states_are_those_of_the_moment(space, camera):
    before = space.states()
    space.observe(wall(2.0), camera, np.eye(4))
    assert (before == UNKNOWN).all() and (space.states() != UNKNOWN).any()


def test_the_box_of_what_is_known_is_one_voxel_wider_than_that(camera):
    space = Occupancy(VoxelGrid(0.05, (-41, -37, -10), (83, 75, 70)))  # not whole vectors
    assert (
        space.known_box()[1] == 0 and not (space.known_box()[0][0] < space.known_box()[0][1]).all()
    )
    depth = np.zeros((120, 160), np.float32)
    depth[40:60, 90:120] = 1.5
    for _ in range(2):
        space.observe(depth, camera, np.eye(4))
    box, occupied = space.known_box()
    known = np.argwhere(space.states().T != UNKNOWN)
    low, end = known.min(axis=0) - 1, known.max(axis=0) + 2
    assert (box == np.clip([low, end], 0, space.states().T.shape)).all()
    assert occupied == (space.states() == OCCUPIED).sum() > 0


def test_a_small_step_moves_no_window(space):
    middle = (space.grid.low + space.grid.high) / 2
    assert not space.move_to(middle + 0.2)
    assert space.move_to(middle + np.array([0.0, 0.0, 0.6]))


def test_a_reach_of_nothing_is_refused():
    with pytest.raises(UserError, match="far_m = 0"):
        Occupancy(VoxelGrid(0.05, (0, 0, 0), (1, 1, 1)), far_m=0.0)


def test_a_grid_that_grows_keeps_what_is_known(camera):
    """The same as if it had been large from the beginning."""
    large = VoxelGrid(0.05, (-40, -36, -20), (80, 70, 100))
    grows, whole = Occupancy(VoxelGrid(0.05, (-30, -30, -10), (60, 60, 80))), Occupancy(large)
    for seed in range(4):
        if seed == 2:
            grows.grow_to(large)
        for one in (grows, whole):
            one.observe(wall(1.5, 0.01, seed), camera, np.eye(4))
    assert grows.grid == large
    np.testing.assert_array_equal(grows.states(), whole.states())
    np.testing.assert_array_equal(grows.surfaces(), whole.surfaces())
    with pytest.raises(ValueError, match="does not cover"):
        grows.grow_to(VoxelGrid(0.05, (-30, -36, -20), (80, 70, 100)))


def test_what_another_one_knows_fills_only_what_is_unknown(space, camera):
    other = Occupancy(space.grid)
    other.observe(wall(2.02), camera, np.eye(4))
    space.observe(wall(1.02), camera, np.eye(4))
    alone = space.states().copy()
    space.fill_from(other)
    assert (space.states() == np.where(alone == UNKNOWN, other.states(), alone)).all()
    assert (space.states() != alone).any()
    occupied = (space.states() == OCCUPIED) & (alone == UNKNOWN)
    assert (space.surfaces()[:, occupied] == other.surfaces()[:, occupied]).all()


def test_another_grid_fills_nothing(space):
    with pytest.raises(ValueError, match="is not"):
        space.fill_from(Occupancy(VoxelGrid(0.05, (0, 0, 0), (4, 4, 4))))
