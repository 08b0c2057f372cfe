"""`hsslam-mesh`: the mesh of a saved map.

What a user can ask of `hsslam-mesh`: one frozen dataclass; every field is an option.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.extract_mesh import DepthViews, extract_mesh
from hsslam_services.commands.cli import exit_code, parse_options, terminal_progress
from hsslam_services.commands.maps.saved_map import SavedMap

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


_PROG = "hsslam-mesh"
_VIEW_PX = 320  # width of the views of maps without images


def main(args: Sequence[str] | None = None) -> None:
    """Exit code 0: written; 1: interrupted; 2: bad input."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _mesh(_options(given))):
        sys.exit(code)


def _options(args: Sequence[str]) -> MeshOptions:
    options = parse_options(MeshOptions, _PROG, args)
    options.expect_map()
    return options


def _mesh(options: MeshOptions) -> None:
    saved = SavedMap(Path(options.map), options.device)
    camera, views = _views(saved)
    bound = saved.checkpoint.layout.bound
    queries = saved.queries
    mesh = extract_mesh(queries.sdf, queries.color, bound, camera, views, options.voxel)
    if len(mesh.faces) == 0:
        raise UserError(f"{options.map}: no surface is seen from its {len(views)} keyframes")
    try:
        mesh.export(options.out)
    except OSError as error:
        raise UserError(f"--out {options.out}: {error.strerror}: expected to write there") from None
    print(f"{options.out}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles")


def _views(saved: SavedMap) -> tuple[Camera, DepthViews]:
    """What the keyframes saw, and by which camera: as measured, or as the map shows it to them."""
    images, poses = saved.checkpoint.images, saved.checkpoint.T_world_keyframe
    if images is not None:
        return saved.camera, DepthViews(partial(saved.measured_depth_m, images), poses)
    camera = saved.camera
    if camera.width_px > _VIEW_PX:
        camera = camera.scaled(_VIEW_PX / camera.width_px)
    views = DepthViews(cache(lambda k: saved.rays.depth(camera, poses[k])), poses)
    with terminal_progress() as progress:
        for k in progress.track(range(len(views)), description="views"):
            views[k]
    return camera, views


if __name__ == "__main__":
    main()
