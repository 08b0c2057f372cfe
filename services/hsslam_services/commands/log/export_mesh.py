"""The newest mesh of a log as files; apart from `export`, so that trimesh comes with a mesh only."""

from collections.abc import Iterator
from pathlib import Path

from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_services.commands.log.newest_mesh import newest_mesh
from hsslam_services.log.reader import Say


def export_mesh(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """mesh.ply in the world of the poses, and mesh.glb turned to y up; vertex colours, m. Yields what
    it wrote; nothing where there is none of the last map."""
    mesh = newest_mesh(files)
    if mesh is None:
        say("no mesh: the log holds none")
        return
    for name in ("mesh.ply", "mesh.glb"):
        path = folder / name
        if name.endswith(".glb"):
            mesh.apply_transform(OPENGL_FROM_OPENCV)
        mesh.export(path)
        yield f"{path}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"
