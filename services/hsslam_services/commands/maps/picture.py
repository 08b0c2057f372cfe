"""A picture of a finished run: the mesh from above and at an angle, the camera's path in it."""

import argparse
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.geometry.view_from_above import looking_down, mean_up

_POINTS = 2_500_000
_PANEL_PX = 800
_BACKGROUND = 250
_PATH_BGR = (40, 40, 230)
_LIGHT = np.array([0.80, 0.48, 0.36])  # a direction, unit length
_FIELD_OF_VIEW = 1.1  # panel width over focal length


def main() -> None:
    """`python -m hsslam_services.commands.maps.picture RUN_DIR` writes RUN_DIR/picture.png and says so."""
    parser = argparse.ArgumentParser(prog="hsslam picture", description=__doc__)
    parser.add_argument("run_dir", type=Path, help="folder of a finished run")
    run_dir = parser.parse_args().run_dir
    try:
        print(f"picture: {draw_run(run_dir)}")
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def draw_run(run_dir: Path) -> Path:
    """Draw mesh.ply and trajectory.txt of a run into picture.png; returns its path.

    Raises:
        UserError: the run left no mesh.
    """
    if not (run_dir / "mesh.ply").exists():
        raise UserError(f"{run_dir / 'mesh.ply'}: not there: expected a run that has finished")
    mesh = trimesh.load_mesh(run_dir / "mesh.ply")
    trajectory = read_tum(run_dir / "trajectory.txt")
    up = mean_up(trajectory.T_world_cam)
    points, colors = _surface(mesh)
    panels = [_panel(points, colors, trajectory, up, angle) for angle in (80.0, 40.0)]
    path = run_dir / "picture.png"
    cv2.imwrite(str(path), np.concatenate(panels, axis=1))
    return path


def _surface(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] m on the surface and their shaded BGR [N, 3]."""
    sampled: Any = trimesh.sample.sample_surface(mesh, _POINTS, seed=0)
    points, faces = sampled[:2]
    corner_colors = np.asarray(mesh.visual.vertex_colors)[mesh.faces[faces]]  # type: ignore[union-attr]
    light = 0.75 + 0.25 * np.abs(mesh.face_normals[faces] @ _LIGHT)
    colors = corner_colors[:, :, 2::-1].mean(axis=1) * light[:, None]
    return np.asarray(points), colors.astype(np.uint8)


def _panel(
    points: np.ndarray, colors: np.ndarray, path: Trajectory, up: np.ndarray, elevation_deg: float
) -> np.ndarray:
    """One perspective view from outside; what hides the room (ceiling, near walls) is left out."""
    camera_up = path.positions @ up
    height = points @ up
    keep = height < np.median(camera_up) + 0.35  # no ceiling
    low, high = np.percentile(points, (1, 99), axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
    centre = centre - up * (centre @ up - np.median(height))
    R = looking_down(up, np.deg2rad(elevation_deg)).T  # world to view
    eye = centre - 0.95 * size * R[2]
    focal = _PANEL_PX / _FIELD_OF_VIEW
    uv, z = _project(points[keep], R, eye, focal)
    image = _splat(uv, z, colors[keep])
    line, _ = _project(path.positions, R, eye, focal)
    cv2.polylines(image, [np.round(line).astype(np.int32)], False, _PATH_BGR, 2, cv2.LINE_AA)
    return image


def _project(
    points: np.ndarray, R: np.ndarray, eye: np.ndarray, focal: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [N, 2] and depths [N] m of points [N, 3]."""
    seen = (points - eye) @ R.T
    return focal * seen[:, :2] / seen[:, 2:] + _PANEL_PX / 2, seen[:, 2]


def _splat(uv: np.ndarray, z: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Points into a z-buffer, [H, W, 3]; the nearest wins."""
    image = np.full((_PANEL_PX, _PANEL_PX, 3), _BACKGROUND, np.uint8)
    pixel = np.floor(uv).astype(int)
    keep = (pixel >= 0).all(axis=1) & (pixel < _PANEL_PX - 1).all(axis=1) & (z > 0)
    order = np.argsort(-z[keep], kind="stable")  # the last write wins
    u, v = pixel[keep][order].T
    for right, down in ((1, 1), (0, 1), (1, 0), (0, 0)):  # each point covers four pixels
        image[v + down, u + right] = colors[keep][order]
    return image


if __name__ == "__main__":
    main()
