"""`hsslam-mesh`: makes a mesh of a saved map."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.export.mesh_file import write_mesh
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.commands.maps.surface import expect_voxel, out_file, surface
from hsslam_services.commands.maps.whole_space import map_file
from hsslam_services.commands.output_files import default_mesh_file, expect_file

_FORMATS = (".ply", ".glb", ".obj", ".stl")
_PROG = "hsslam-mesh"


@dataclass(frozen=True)
class MeshOptions:
    """Makes a mesh of a saved map, without the service.

    Example:
      hsslam-mesh runs/desk --voxel 0.01 --out room.ply

    The mesh has coloured triangles of the surface that the keyframes observed, in m and in the world frame; a
    .glb has y up and z back, as glTF requires. With --voxel equal to --slam.mesher.final-voxel-m (0.03) it
    is the mesh.ply of the run that saved the map. Maps saved before version 3 contain no keyframe depth; for
    them, all surface visible from a keyframe counts as observed.

    Exit codes: 0 if the mesh is written, 1 if the command is interrupted, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("map",)
    VALUES: ClassVar = {"map": "MAP"}
    ALIASES: ClassVar = {"out": "-o"}

    map: str = ""
    """Run folder, or the file of a saved map."""
    voxel: float = 0.02
    """Voxel size of marching cubes, m."""
    out: Path | None = None
    """Output file: .ply, .glb, .obj or .stl (none: mesh.ply)."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the map is evaluated; auto: an NVIDIA GPU if one works."""

    def __post_init__(self) -> None:
        expect_voxel(self.voxel)
        if self.out is not None and self.out.suffix.lower() not in _FORMATS:
            raise UserError(f"--out {self.out}: expected a file {', '.join(_FORMATS)}")

    def expect_files(self) -> tuple[Path, Path]:
        """The files of map and mesh; UserError if no map is given, or the mesh cannot be there."""
        path, out = map_file(self.map, "mesh"), self.out or default_mesh_file()
        expect_file("--out", out)
        return path, out


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0, 1 or 2, see `MeshOptions`."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _mesh(parse_options(MeshOptions, _PROG, given))):
        sys.exit(code)


def _mesh(options: MeshOptions) -> None:
    path, out = options.expect_files()
    mesh = surface(SavedMap.open(path, options.device), path, options.voxel)
    with out_file(out) as partial:
        write_mesh(partial, mesh)
    print(f"{out}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles")


if __name__ == "__main__":
    main()
