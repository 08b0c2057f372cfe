"""A mesh with vertex colours as binary glTF."""

import json

import numpy as np
import trimesh

from hsslam_node.export.mesh_file import write_mesh
from hsslam_node.geometry.triangles import triangle_mesh


def test_a_mesh_is_matt_and_seen_from_both_sides(tmp_path):
    """A file without a material is of polished metal, which has no colour of its own."""
    path, colors = tmp_path / "mesh.glb", np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]])
    vertices = [[0.0, 0, 0], [1, 0, 0], [1, 1, 2]]
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2]], vertex_colors=colors, process=False)
    write_mesh(path, mesh)
    np.testing.assert_array_equal(mesh.vertices, vertices)  # as it was
    whole = path.read_bytes()
    tree = json.loads(whole[20 : 20 + int.from_bytes(whole[12:16], "little")])
    (material,) = tree["materials"]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0 and material["doubleSided"]
    assert [p["material"] for m in tree["meshes"] for p in m["primitives"]] == [0]
    found = triangle_mesh(path, "a mesh")
    np.testing.assert_allclose(found.vertices[2], [1, -1, -2])
    np.testing.assert_array_equal(np.asarray(found.visual.vertex_colors)[:, :3], colors)
