"""The newest mesh of a log."""

from pathlib import Path

import trimesh

from hsslam_node.proto import messages
from hsslam_node.proto.mesh_codec import mesh_arrays
from hsslam_node.proto.topics import MESH
from hsslam_node.services.log.log_file import Logged, bus_messages


def newest_mesh(files: list[Path]) -> trimesh.Trimesh | None:
    """Coloured triangles (m, world of the poses) from the files of one log; None where they hold none.

    Raises:
        UserError: a file is damaged, or of a version that cannot be read.
    """
    newest: Logged | None = None
    for logged in bus_messages(files, {MESH.name}):
        newest = logged
    if newest is None:
        return None
    message = newest.message()
    assert isinstance(message, messages.Mesh)
    vertices, faces, colors = mesh_arrays(message)
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
