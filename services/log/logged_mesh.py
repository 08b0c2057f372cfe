"""The newest mesh of a log."""

from pathlib import Path

import trimesh

from hsslam_node.proto import messages
from hsslam_node.proto.mesh_codec import mesh_arrays
from hsslam_node.proto.topics import KEYFRAME, MESH
from hsslam_node.services.log.log_file import Logged, bus_messages
from hsslam_node.services.world_order import WorldOrder


def newest_mesh(files: list[Path]) -> trimesh.Trimesh | None:
    """Coloured triangles (m, world of the poses) from the files of one log; None where they hold none of
    the last map.

    Raises:
        UserError: a file is damaged, or of a version that cannot be read.
    """
    newest: Logged | None = None
    worlds = WorldOrder()
    for logged in bus_messages(files, {MESH.name, KEYFRAME.name}):
        if logged.topic is MESH:
            newest = logged
        else:
            worlds.begins_with(logged.message())
    message = None if newest is None else newest.message()
    if message is None or worlds.is_past(message):
        return None
    assert isinstance(message, messages.Mesh)
    vertices, faces, colors = mesh_arrays(message)
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
