import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_proto import topics
from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.codec import mesh_arrays, mesh_message


@given(st.integers(0, 20), st.integers(0, 20), st.integers(0, 2**32))
def test_meshes_come_back_equal_and_aligned(vertex_count, face_count, map_version):
    rng = np.random.default_rng(vertex_count * 21 + face_count)
    vertices = rng.normal(size=(vertex_count, 3)).astype(np.float32)
    faces = rng.integers(0, max(vertex_count, 1), (face_count if vertex_count else 0, 3))
    colors = rng.integers(0, 256, (vertex_count, 3), dtype=np.uint8)
    message = mesh_message(vertices, faces, colors, map_version)
    back = decode(topics.MESH, encode(topics.MESH, message), encoding_of(topics.MESH))
    assert isinstance(back, mesh_messages.Mesh)
    for array, expected in zip(mesh_arrays(back), (vertices, faces, colors), strict=True):
        np.testing.assert_array_equal(array, expected)
        assert array.flags.aligned
