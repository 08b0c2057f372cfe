"""Measures how well exported meshes of a run reproduce frames that are no keyframes; prints JSON.

`python -m hsslam_bench.scripts.texture_quality RUN SOURCE` exports the saved map of a run folder with
`hsslam-map export --format glb`, once with vertex colours and once with a texture. It reads both files and
draws them from the run's poses of every eighth frame. A pixel counts if both meshes have the
frame's depth there, so that only colours differ. A factor fitted to each view removes changes of exposure.
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
from hsslam_node.geometry.triangles import triangle_mesh
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_node.sources.open_source import open_source
from hsslam_services.commands.maps.command import main as hsslam_map

_EVERY, _FIRST = 8, 3  # odd frames: keyframes of a steady camera are even
_SAME_M = 0.03
_NEAR_NS = 2_000_000  # tolerance for rounded stamps


def main() -> None:
    parser = argparse.ArgumentParser(prog="texture_quality", description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("source")
    parser.add_argument("--quick", action="store_true", help="larger triangles")
    arguments = parser.parse_args()
    more = ("--voxel", "0.05") if arguments.quick else ()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        plain, _ = exported(arguments.run, place / "plain.glb", *more)
        textured, seconds = exported(arguments.run, place / "textured.glb", "--texture", *more)
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


def exported(run: Path, out: Path, *more: str) -> tuple[trimesh.Trimesh, float]:
    """Export a mesh with the command; returns it in the map's axes, and the seconds that this took."""
    arguments = ["export", str(run), "--format", "glb", "--out", str(out), "--device", "cpu", *more]
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        if code := hsslam_map(arguments):
            raise SystemExit(code)
    seconds = time.perf_counter() - began
    mesh = triangle_mesh(out, "expected the exported mesh")
    mesh.apply_transform(OPENGL_FROM_OPENCV)  # its own inverse
    return mesh, seconds


def _other_frames(run: Path, spec: str) -> Iterator[tuple[Frame, np.ndarray]]:
    """Frames that are no keyframes, with their poses T_world_cam [4, 4] in the run."""
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
    """Mask [H, W] of the pixels whose drawn depth [H, W] m agrees with the frame's depth."""
    return (frame.depth_raw > 0) & (np.abs(depth_m - frame.depth_m()) < _SAME_M)


def _fitted_psnr_db(drawn: np.ndarray, true: np.ndarray) -> float:
    """PSNR of colours [n, 3] in 0..1, after multiplication by the least-squares factor."""
    return psnr_db(drawn * ((drawn * true).sum() / (drawn * drawn).sum()), true)


if __name__ == "__main__":
    main()
