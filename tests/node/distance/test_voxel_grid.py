import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound

GRID = VoxelGrid(0.05, (-10, 4, 0), (20, 10, 5))
coordinates = st.tuples(*[st.floats(-30, 30)] * 3)


@given(coordinates)
def test_the_voxel_of_a_point_holds_it(point):
    centre = GRID.centres(GRID.indices(np.array([point])))[0]
    assert (np.abs(centre - point) <= 0.025 + 1e-9).all()


@given(coordinates, st.sampled_from([0.02, 0.05, 0.3]))
def test_a_grid_around_a_point_has_it_in_its_middle(point, voxel_m):
    grid = VoxelGrid.around(np.array(point), (2.0, 3.0, 1.0), voxel_m)
    middle = (grid.low + grid.high) / 2
    assert (np.abs(middle - point) <= voxel_m / 2 + 1e-9).all()
    assert np.allclose(grid.high - grid.low, (2.0, 3.0, 1.0), atol=voxel_m)


@given(coordinates, st.tuples(*[st.floats(0.01, 10)] * 3))
def test_a_grid_over_a_box_covers_it_with_less_than_a_voxel_to_spare(low, extent):
    bound = Bound.of(np.array(low), np.add(low, extent))
    grid = VoxelGrid.over(bound, 0.1)
    assert (grid.low <= np.add(bound.low, 1e-6)).all()
    assert (grid.high >= np.subtract(bound.high, 1e-6)).all()
    assert (grid.low > np.subtract(bound.low, 0.1 + 1e-6)).all()
    assert (grid.high < np.add(bound.high, 0.1 + 1e-6)).all()


def test_grids_of_one_voxel_size_share_their_lattice():
    other = GRID.moved(np.array([3, -2, 1]))
    index = np.array([[5, 5, 2]])
    assert np.allclose(other.centres(index - [3, -2, 1]), GRID.centres(index))


def test_the_transform_agrees_with_the_indices():
    indices = np.array([[0, 0, 0], [19, 9, 4]])
    T = GRID.T_index_frame()
    assert np.allclose(GRID.centres(indices) @ T[:3, :3].T + T[:3, 3], indices)
    assert GRID.holds(indices).all()
    assert not GRID.holds(np.array([[20, 0, 0], [0, -1, 0]])).any()


@pytest.mark.parametrize("voxel_m", [0.0, -0.1, float("nan")])
def test_a_voxel_without_size_is_refused(voxel_m):
    for make in (
        lambda: VoxelGrid(voxel_m, (0, 0, 0), (1, 1, 1)),
        lambda: VoxelGrid.around(np.zeros(3), (1.0, 1.0, 1.0), voxel_m),
    ):
        with pytest.raises(UserError, match="expected metres above 0"):
            make()


def test_too_many_voxels_are_refused():
    with pytest.raises(UserError, match=r"voxels of 0\.01 m: expected 1 to 1073741824 voxels"):
        VoxelGrid.around(np.zeros(3), (100.0, 100.0, 100.0), 0.01)
