"""How well the exported meshes of a run draw frames that are no keyframes, as JSON on stdout.

`python -m hsslam_bench.scripts.texture_quality RUN SOURCE`: `hsslam-map export --format glb` writes the saved
map of a run folder with colours of vertices and with a texture. Both are read again by trimesh, and drawn
from the poses that the run gave to every eighth frame. Pixels count where both meshes have the depth that the
frame measured, as only colours are compared. The exposure of a camera that changes it is no property of a
mesh: each drawn view is multiplied by the factor that fits it best.
"""

import argparse
import contextlib
import io
import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.evaluation.image_quality import psnr_db
from hsslam_node.evaluation.mesh.mesh_view import MeshView
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_node.sources.open_source import open_source
from hsslam_services.commands.maps.command import main as hsslam_map

_EVERY, _FIRST = 8, 3  # keyframes of a steady camera are even numbers
_SAME_M = 0.03
_NEAR_NS = 2_000_000  # stamps of a trajectory are rounded to microseconds, at least


def main() -> None:
    parser = argparse.ArgumentParser(prog="texture_quality", description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("source")
    parser.add_argument("--quick", action="store_true", help="larger triangles")
    arguments = parser.parse_args()
    more = ("--voxel", "0.05") if arguments.quick else ()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        plain, _ = _exported(arguments.run, place / "plain.glb", *more)
        textured, seconds = _exported(arguments.run, place / "textured.glb", "--texture", *more)
        megabytes = (place / "textured.glb").stat().st_size / 1e6
    views = [MeshView(plain), MeshView(textured)]
    rows: list[list[float]] = []
    for frame, T_world_cam in _other_frames(arguments.run, arguments.source):
        drawn = [view.draw(frame.camera, T_world_cam) for view in views]
        covered = np.logical_and(*(_is_true(depth_m, frame) for _, depth_m in drawn))
        true = frame.color[covered] / 255.0
        rows.append([_fitted_psnr_db(image[covered], true) for image, _ in drawn])
    vertices_db, texture_db = np.mean(rows, axis=0)
    print(
        json.dumps(
            {
                "vertices_db": float(vertices_db),
                "texture_db": float(texture_db),
                "views": len(rows),
                "seconds": seconds,
                "triangles": len(textured.faces),
                "megabytes": megabytes,
            }
        )
    )


def _exported(run: Path, out: Path, *more: str) -> tuple[trimesh.Trimesh, float]:
    """The mesh of a file that the command writes, in the map's axes, and the seconds that it took."""
    arguments = ["export", str(run), "--format", "glb", "--out", str(out), "--device", "cpu", *more]
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        if code := hsslam_map(arguments):
            raise SystemExit(code)
    seconds = time.perf_counter() - began
    mesh = trimesh.load_mesh(out, process=False)
    mesh.apply_transform(OPENGL_FROM_OPENCV)  # its own inverse
    return mesh, seconds


def _other_frames(run: Path, spec: str) -> Iterator[tuple[Frame, np.ndarray]]:
    """Frames that are no keyframes, with the poses T_world_cam [4, 4] that the run gave them."""
    trajectory = read_tum(run / "trajectory.txt")
    keyframes_ns = load_checkpoint(run / "map.safetensors").keyframe_stamps_ns
    for number, frame in enumerate(open_source(spec).frames()):
        if number % _EVERY != _FIRST or not isinstance(frame, Frame):
            continue
        nearest = int(np.abs(trajectory.stamps_ns - frame.stamp_ns).argmin())
        is_known = abs(int(trajectory.stamps_ns[nearest]) - frame.stamp_ns) < _NEAR_NS
        if is_known and np.abs(keyframes_ns - frame.stamp_ns).min() > _NEAR_NS:
            yield frame, trajectory.T_world_cam[nearest]


def _is_true(depth_m: np.ndarray, frame: Frame) -> np.ndarray:
    """Mask [H, W] of the pixels whose drawn depth [H, W] m is that of the frame."""
    return (frame.depth_raw > 0) & (np.abs(depth_m - frame.depth_m()) < _SAME_M)


def _fitted_psnr_db(drawn: np.ndarray, true: np.ndarray) -> float:
    """Of colours [n, 3] 0..1, after the factor of least squares."""
    return psnr_db(drawn * ((drawn * true).sum() / (drawn * drawn).sum()), true)


if __name__ == "__main__":
    main()
