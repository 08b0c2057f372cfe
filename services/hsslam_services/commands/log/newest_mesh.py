"""The newest mesh of a log: the final mesh, or the live mesh assembled from its blocks."""

from pathlib import Path
from typing import NamedTuple

import trimesh

from hsslam_proto.map_epoch import EpochOrder
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.assembled import AssembledMesh
from hsslam_proto.mesh.codec import mesh_arrays
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.topics import KEYFRAME, MESH, MESH_BLOCKS
from hsslam_services.log.reading.reader import Logged, bus_messages


class LoggedMesh(NamedTuple):
    """Coloured triangles (m, world of the poses). The final mesh shows the whole map, a live one may not."""

    triangles: trimesh.Trimesh
    is_final: bool


def newest_mesh(files: list[Path]) -> LoggedMesh | None:
    """The newest mesh in the files of one log; None if the last map has no mesh.

    Raises:
        UserError: a file is damaged, or of an unknown version.
    """
    final: Logged | None = None
    live = AssembledMesh()
    epochs = EpochOrder()
    for logged in bus_messages(files, {MESH.name, MESH_BLOCKS.name, KEYFRAME.name}):
        if logged.topic is MESH:
            final = logged
            continue
        message = logged.message()
        epochs.begins_with(message)
        if isinstance(message, MeshBlocks):
            live.add(message)
    message = None if final is None else final.message()
    triangles = live.whole() if live.map_epoch == epochs.now else None
    is_final = isinstance(message, mesh_messages.Mesh) and not epochs.is_past(message)
    if is_final:
        triangles = mesh_arrays(message)
    if triangles is None:
        return None
    vertices, faces, colors = triangles
    whole = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    return LoggedMesh(whole, is_final)
