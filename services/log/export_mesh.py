"""The newest mesh of a log as files."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.proto import messages
from hsslam_node.proto.mesh_codec import mesh_arrays
from hsslam_node.proto.topics import MESH
from hsslam_node.services.log.log_file import Logged, Say, bus_messages

_UP = np.diag([1.0, -1.0, -1.0, 1.0])  # from x right, y down, z forward to glTF's y up, z back


def export_mesh(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """mesh.ply in the world of the poses, and mesh.glb turned to y up; vertex colours, m. Yields what
    it wrote."""
    newest: Logged | None = None
    for logged in bus_messages(files, {MESH.name}):
        newest = logged
    if newest is None:
        say("no mesh: the log holds none")
        return
    message = newest.message()
    assert isinstance(message, messages.Mesh)
    vertices, faces, colors = mesh_arrays(message)
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    for name in ("mesh.ply", "mesh.glb"):
        path = folder / name
        if name.endswith(".glb"):
            mesh.apply_transform(_UP)
        mesh.export(path)
        yield f"{path}: {len(vertices)} vertices, {len(faces)} triangles"
