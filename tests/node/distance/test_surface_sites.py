import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation

from hsslam_node.distance.kernels.distance_transform import marks, no_site, padded_width
from hsslam_node.distance.kernels.known_voxels import known_box, room_for_states
from hsslam_node.distance.kernels.surface_sites import SITE_COLUMNS, mark_near_known, number_sites
from hsslam_node.distance.states import OCCUPIED, UNKNOWN

shapes = st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 70))


def _states(shape, seed):
    """Few known voxels, in memory that ends with the grid's neighbour: 7, which is no state."""
    states = room_for_states(shape)
    states.base[:] = 7
    rng = np.random.default_rng(seed)
    states[:] = rng.integers(0, 3, shape) * (rng.random(shape) < 0.1)
    return states


@given(shapes, st.integers(0, 1000))
def test_known_voxels_and_those_beside_them_are_marked(shape, seed):
    states, box = _states(shape, seed), np.empty((2, 3), np.int64)
    known_box(states, box)
    low, (nz, ny, nx) = box[0], np.maximum(box[1] - box[0], 0)
    if not nz * ny * nx:
        assert (states == UNKNOWN).all()
        return
    needed = np.full((nz, ny, padded_width(nx) // 16), 0xFFFF, np.uint16)
    mark_near_known(states, low, nx, needed)
    near = binary_dilation(states != UNKNOWN, np.ones((3, 3, 3)))
    inside = tuple(slice(*ends) for ends in box.T)
    assert (needed == marks(near[inside])).all()


@given(shapes, st.integers(0, 1000))
def test_sites_are_numbered_in_the_order_of_memory(shape, seed):
    states, box = _states(shape, seed), np.empty((2, 3), np.int64)
    count = known_box(states, box)
    nz, ny, nx = np.maximum(box[1] - box[0], 0)
    keys = np.zeros((nz, ny, padded_width(nx)), np.uint32)
    sites = np.zeros((count + 1, SITE_COLUMNS), np.float32)
    surface = np.zeros((*shape, 8), np.int8)
    surface[..., 6], surface[..., 7] = 127, 25  # a quarter of a voxel up along z
    none = no_site(40, 16)
    number_sites(states, surface, box[0], none, keys, sites)
    occupied = states[tuple(slice(*ends) for ends in box.T)] == OCCUPIED
    assert occupied.sum() == count == (states == OCCUPIED).sum()
    assert (keys[:, :, :nx][occupied] == np.arange(count)).all()
    assert (keys[:, :, :nx][~occupied] == none).all() and (keys[:, :, nx:] == none).all()
    places = np.argwhere(occupied)[:, ::-1]
    np.testing.assert_allclose(sites[:count, :3], places + np.array([0, 0, 0.25]), atol=1e-6)
    np.testing.assert_allclose(sites[:count, 3:6], np.tile([0, 0, 1], (count, 1)), atol=1e-6)
