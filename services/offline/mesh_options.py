"""What a user can ask of `hsslam-mesh`: one frozen dataclass; every field is an option."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hsslam_node.errors import UserError

_FORMATS = (".ply", ".glb", ".obj", ".stl")


@dataclass(frozen=True)
class MeshOptions:
    """Mesh of a saved map, without the service.

    $ hsslam-mesh map.safetensors --voxel 0.01 --out room.ply

    Coloured triangles (m, world) of the surface that the keyframes of the map have seen: with --voxel as its
    --slam.mesher.final-voxel-m (0.03), the mesh.ply of the run that left the map. A map of before version 3
    holds no depth of its keyframes: of that, what its own surface shows to them counts as seen.

    Exit code 0: written; 1: interrupted; 2: bad input, told in one line.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    map: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MAP")] = ""
    """File of a saved map, as a run leaves it: map.safetensors."""
    voxel: float = 0.02
    """Cell of marching cubes, m."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("mesh.ply")
    """File of the mesh: .ply, .glb, .obj or .stl."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the map is asked (auto: an NVIDIA GPU if one works, else the CPU)."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.voxel) and 0.001 <= self.voxel <= 1):
            raise UserError(f"--voxel {self.voxel}: expected 0.001 to 1 m")
        if self.out.suffix.lower() not in _FORMATS:
            raise UserError(f"--out {self.out}: expected a file {', '.join(_FORMATS)}")

    def expect_map(self) -> None:
        """UserError where no map is named, or the mesh has no folder to lie in."""
        if not self.map:
            raise UserError("no map: expected hsslam-mesh MAP, as map.safetensors")
        if not self.out.absolute().parent.is_dir():
            raise UserError(f"--out {self.out}: expected a file in a folder that is there")
