"""The mesh of a saved map, and an output file for it; `hsslam-mesh` and `hsslam-map export` share it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trimesh import Trimesh

from hsslam_node.config.meshing import VOXEL_RANGE_M
from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import terminal_progress


def expect_voxel(voxel_m: float) -> None:
    """Raise UserError unless `--voxel` is in the range for marching cubes."""
    low_m, high_m = VOXEL_RANGE_M
    if not low_m <= voxel_m <= high_m:
        raise UserError(f"--voxel {voxel_m}: expected {low_m:g} to {high_m:g} m")


def surface(saved: SavedMap, path: Path | str, voxel_m: float) -> Trimesh:
    """The coloured mesh of the surface that the keyframes saw (m, world); errors name `path`.

    Raises:
        UserError: the keyframes saw no surface that voxels of this size show, or the voxels are too many.
    """
    if saved.checkpoint.images is None:
        _draw_views(saved)
    try:
        mesh = saved.mesh(voxel_m)
    except UserError as error:
        text = str(error).replace(f"mesh.voxel_m = {voxel_m}", f"--voxel {voxel_m:g}")
        raise type(error)(text) from None  # also if memory does not suffice
    if len(mesh.faces) == 0:
        raise UserError(
            f"{path}: its {len(saved.keyframes)} keyframes see no surface with --voxel {voxel_m:g}: expected "
            "smaller voxels, or a map with a surface"
        )
    return mesh


@contextmanager
def out_file(out: Path, option: str = "--out") -> Iterator[Path]:
    """A temporary path for the file of an option; the complete file then replaces an older one.

    Raises:
        UserError: the file cannot be written.
    """
    try:
        with durable_file(out) as partial:
            yield partial
    except OSError as error:
        raise UserError(
            f"{option} {out}: {error.strerror}: expected a file that can be written"
        ) from None


def _draw_views(saved: SavedMap) -> None:
    """Render the depth of each keyframe of an old map, which has none saved, with a progress bar."""
    with terminal_progress() as progress:
        for k in progress.track(range(len(saved.keyframes)), description="views"):
            saved.keyframes.depth_m(k)
