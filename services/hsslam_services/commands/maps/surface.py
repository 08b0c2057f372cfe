"""The surface of a saved map, and a file for it: what `hsslam-mesh` and `hsslam-map export` share."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trimesh import Trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_services.commands.cli import terminal_progress


def expect_voxel(voxel_m: float) -> None:
    """UserError unless `--voxel` makes sense for marching cubes."""
    if not (math.isfinite(voxel_m) and 0.001 <= voxel_m <= 1):
        raise UserError(f"--voxel {voxel_m}: expected 0.001 to 1 m")


def surface(saved: SavedMap, path: Path | str, voxel_m: float) -> Trimesh:
    """The coloured mesh of what the keyframes saw (m, world); `path` stands in the error.

    Raises:
        UserError: they saw no surface.
    """
    if saved.checkpoint.images is None:
        _draw_views(saved)
    mesh = saved.mesh(voxel_m)
    if len(mesh.faces) == 0:
        raise UserError(
            f"{path}: its {len(saved.keyframes)} keyframes see no surface: expected a map with a surface"
        )
    return mesh


@contextmanager
def out_file(out: Path, option: str = "--out") -> Iterator[Path]:
    """A place to write an option's file at; it appears whole or not at all, in the place of an older one.

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
    """What the keyframes of an old map saw is drawn, each once: show that it goes on."""
    with terminal_progress() as progress:
        for k in progress.track(range(len(saved.keyframes)), description="views"):
            saved.keyframes.depth_m(k)
