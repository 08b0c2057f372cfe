"""`hsslam-mesh`: the mesh of a saved map."""

import sys
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.depth_views import DepthViews
from hsslam_node.meshing.extract_mesh import extract_mesh
from hsslam_node.services.exit_code import exit_code
from hsslam_node.services.offline.mesh_options import MeshOptions
from hsslam_node.services.offline.saved_map import SavedMap
from hsslam_node.services.parse_options import parse_options
from hsslam_node.services.terminal_progress import terminal_progress

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
