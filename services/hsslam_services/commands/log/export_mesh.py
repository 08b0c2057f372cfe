"""Writes the newest mesh of a log; apart from `export`, so that only a mesh imports trimesh."""

from collections.abc import Iterator
from pathlib import Path

from hsslam_node.durable_file import durable_file
from hsslam_node.export.mesh_file import write_mesh
from hsslam_services.commands.log.newest_mesh import newest_mesh
from hsslam_services.log.reading.files import Say

_NAMES = ("mesh.ply", "mesh.glb")


def export_mesh(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """Write mesh.ply in the world of the poses, and mesh.glb with y up; vertex colours, m. Yields a line for
    each file; nothing if the last map has no mesh."""
    found = newest_mesh(files)
    if found is None:
        for name in _NAMES:  # of an earlier export
            (folder / name).unlink(missing_ok=True)
        say("no mesh: the log has none")
        return
    mesh, is_final = found
    if not is_final:
        say("mesh: the live one, which may lack parts of the map, as the log has no final mesh")
    for name in _NAMES:
        path = folder / name
        with durable_file(path) as partial:
            write_mesh(partial, mesh)
        yield f"{path}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"
