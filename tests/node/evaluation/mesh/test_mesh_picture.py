"""Pictures of meshes whose colours come from vertices, from a texture or from a material."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from hsslam_node.evaluation.mesh.mesh_judge import MeshJudge
from hsslam_node.evaluation.mesh.mesh_picture import MeshPicture
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera

_CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
_CORNERS = [[-0.5, -0.5, 2.0], [0.5, -0.5, 2.0], [-0.5, 0.5, 2.0], [0.5, 0.5, 2.0]]
_RED, _BLUE, _GREEN = [255, 0, 0], [0, 0, 255], [0, 255, 0]
_LEFT_AND_RIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
_TEXTURE = Image.fromarray(np.array([[_RED, _BLUE]], np.uint8))


def _picture(visual) -> np.ndarray:
    """Of a wall, as its camera sees it."""
    wall = trimesh.Trimesh(_CORNERS, [[0, 2, 1], [1, 2, 3]], visual=visual, process=False)
    given = Views(_CAMERA, np.eye(4)[None], np.full((1, 48, 64), 2.0, np.float32))
    return MeshPicture(wall, MeshJudge(wall, given, [], _CAMERA)).inside("color")


@pytest.mark.parametrize(
    ("textured", "colors"),
    [
        (SimpleMaterial(image=_TEXTURE), [_RED, _BLUE, _RED, _BLUE]),
        (PBRMaterial(baseColorTexture=_TEXTURE), [_RED, _BLUE, _RED, _BLUE]),
        (PBRMaterial(baseColorFactor=[*_GREEN, 255]), [_GREEN] * 4),
    ],
)
def test_the_colours_of_a_texture_are_those_of_vertices_at_its_places(textured, colors):
    found = _picture(TextureVisuals(_LEFT_AND_RIGHT, material=textured))
    of_vertices = _picture(ColorVisuals(vertex_colors=np.array(colors, np.uint8)))
    np.testing.assert_array_equal(found, of_vertices)
    assert len(np.unique(found.reshape(-1, 3), axis=0)) > 1


def test_a_mesh_without_colours_is_grey():
    found = _picture(TextureVisuals(material=SimpleMaterial()))
    np.testing.assert_array_equal(found, _picture(ColorVisuals()))
