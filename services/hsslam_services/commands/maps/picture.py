"""Draws a picture of a finished run: the mesh and the camera's path, from above and at an angle."""

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.distance.floor_plane import floor_by
from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError
from hsslam_node.evaluation.mesh.mesh_judge import load_mesh
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.geometry.view_from_above import looking_down, mean_ahead, mean_up
from hsslam_services.commands.cli import exit_code
from hsslam_services.commands.maps.whole_space import MAP_NAME

_POINTS = 2_500_000
_PANEL_PX = 800
_BACKGROUND = 215
_PATH_BGR = (40, 40, 230)
_LIGHT = np.array([0.80, 0.48, 0.36])  # a direction, unit length
_AWAY = 0.9  # distance from the mesh's middle to the eye, in sizes of the mesh
_FILLED = 0.92  # part of a panel that the mesh fills


def main() -> None:
    """`python -m hsslam_services.commands.maps.picture RUN_DIR` writes RUN_DIR/picture.png."""
    parser = argparse.ArgumentParser(prog="hsslam picture", description=__doc__)
    parser.add_argument("run_dir", type=Path, help="folder of a finished run")
    run_dir = parser.parse_args().run_dir
    sys.exit(exit_code(lambda: print(f"picture: {draw_run(run_dir)}")))


def draw_run(run_dir: Path) -> Path:
    """Draw mesh.ply and trajectory.txt of a run into picture.png; returns its path.

    Raises:
        UserError: the run left no mesh or no poses, a file is damaged, or the picture cannot be written.
    """
    if not (run_dir / "mesh.ply").exists():
        raise UserError(f"{run_dir / 'mesh.ply'}: does not exist: expected a finished run")
    mesh = load_mesh(run_dir / "mesh.ply")
    trajectory = read_tum(run_dir / "trajectory.txt")
    if len(trajectory) == 0:
        raise UserError(f"{run_dir / 'trajectory.txt'}: no poses: expected one or more")
    up, surface = _up(run_dir, trajectory), _surface(mesh)
    panels = [_panel(surface, trajectory, up, angle) for angle in (80.0, 40.0)]
    path = run_dir / "picture.png"
    _, data = cv2.imencode(".png", np.concatenate(panels, axis=1))
    try:
        write_durably(path, data.tobytes())
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a file that can be written") from None
    return path


def _up(run_dir: Path, trajectory: Trajectory) -> np.ndarray:
    """Up [3], world: of the floor in the run's map, or of the images if the run saved no map."""
    if not (run_dir / MAP_NAME).exists():
        return mean_up(trajectory.T_world_cam)
    saved = SavedMap.open(run_dir)
    known, seen = saved.checkpoint, saved.keyframes
    floor = floor_by(known.gravity, seen.views, seen.camera, known.T_level_world, saved.max_depth_m)
    return np.asarray(floor.up)


class _Surface(NamedTuple):
    """Points on a mesh."""

    points: np.ndarray  # [N, 3] m, world
    normals: np.ndarray  # [N, 3] unit length, towards free space
    colors: np.ndarray  # [N, 3] uint8 BGR, shaded


def _surface(mesh: trimesh.Trimesh) -> _Surface:
    sampled: Any = trimesh.sample.sample_surface(mesh, _POINTS, seed=0)
    points, faces = sampled[:2]
    corner_colors = np.asarray(mesh.visual.vertex_colors)[mesh.faces[faces]]  # type: ignore[union-attr]
    normals = mesh.face_normals[faces]
    light = 0.75 + 0.25 * np.abs(normals @ _LIGHT)
    colors = corner_colors[:, :, 2::-1].mean(axis=1) * light[:, None]
    return _Surface(np.asarray(points), normals, colors.astype(np.uint8))


def _panel(surface: _Surface, path: Trajectory, up: np.ndarray, elevation_deg: float) -> np.ndarray:
    """One perspective view from outside, in the camera's mean direction.

    It leaves out surfaces that face away: ceiling and near walls.
    """
    points = surface.points
    low, high = np.percentile(points, (1, 99), axis=0)
    R = looking_down(up, mean_ahead(path.T_world_cam), np.deg2rad(elevation_deg)).T  # world to view
    eye = (low + high) / 2 - _AWAY * float(np.linalg.norm(high - low)) * R[2]
    is_front = ((eye - points) * surface.normals).sum(axis=1) > 0
    if not is_front.any():  # nothing but a ceiling
        is_front[:] = True
    (seen, z), (line, _) = (_project(p, R, eye) for p in (points[is_front], path.positions))
    low, high = np.percentile(seen, (0.1, 99.9), axis=0)
    low, high = np.minimum(low, line.min(axis=0)), np.maximum(high, line.max(axis=0))
    scale_px = _FILLED * _PANEL_PX / float((high - low).max())
    seen_px, line_px = ((uv - (low + high) / 2) * scale_px + _PANEL_PX / 2 for uv in (seen, line))
    image = _splat(seen_px, z, surface.colors[is_front])
    cv2.polylines(image, [np.round(line_px).astype(np.int32)], False, _PATH_BGR, 2, cv2.LINE_AA)
    return image


def _project(points: np.ndarray, R: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image coordinates [N, 2] for focal length 1, and depths [N] m of points [N, 3]."""
    seen = (points - eye) @ R.T
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


def _splat(uv: np.ndarray, z: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Draw points with a z-buffer, [H, W, 3]; the nearest wins."""
    image = np.full((_PANEL_PX, _PANEL_PX, 3), _BACKGROUND, np.uint8)
    pixel = np.floor(uv).astype(int)
    keep = (pixel >= 1).all(axis=1) & (pixel < _PANEL_PX - 1).all(axis=1) & (z > 0)
    order = np.flatnonzero(keep)[np.argsort(-z[keep], kind="stable")]  # the last write wins
    (u, v), colors = pixel[order].T, colors[order]
    for right, down in np.ndindex(3, 3):  # each point covers nine pixels
        image[v + down - 1, u + right - 1] = colors
    return image


if __name__ == "__main__":
    main()
