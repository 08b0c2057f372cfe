import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.meshing.block_mesh import BlockMesh
from hsslam_node.meshing.observed_space import ObservedSpace
from hsslam_node.meshing.weld import weld_blocks

SPACE = ObservedSpace(Bound((0.0, 0.0, 0.0), (1.6, 0.8, 0.8)), 0.1, 8)
FACE = np.array([[0, 1, 2]])
GREY = np.full((3, 3), 128, np.uint8)


def _mesh(block, vertices):
    return BlockMesh(block, np.array(vertices, np.float32), FACE, GREY)


def test_vertices_on_the_same_edge_become_one():
    a = _mesh((0, 0, 0), [[8, 2.50, 3], [8, 3.5, 3], [7.5, 3, 3]])
    b = _mesh((1, 0, 0), [[0, 2.51, 3], [0, 3.5, 3], [0.5, 3, 3]])
    mesh = weld_blocks([a, b], SPACE, 1)
    assert len(mesh.vertices) == 4 and len(mesh.faces) == 2
    assert len(weld_blocks([a, b], SPACE, 3).faces) == 0  # one piece of two faces


def test_positions_are_in_the_world():
    mesh = weld_blocks([_mesh((1, 0, 0), [[0, 0, 0], [1, 0.5, 0], [0, 0, 2]])], SPACE, 1)
    got = np.sort(np.asarray(mesh.vertices), axis=0)
    np.testing.assert_allclose(got, [[0.8, 0, 0], [0.8, 0, 0], [0.9, 0.05, 0.2]], atol=1e-6)


def test_faces_that_collapse_are_dropped():
    sliver = _mesh((0, 0, 0), [[1.00001, 1, 1], [1, 1.00001, 1], [2, 1.5, 1]])
    assert len(weld_blocks([sliver], SPACE, 1).faces) == 0


def test_no_blocks_is_an_empty_mesh():
    assert len(weld_blocks([], SPACE, 1).vertices) == 0
