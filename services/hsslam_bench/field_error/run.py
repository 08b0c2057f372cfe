"""Error of the map at true surfaces, made at true poses, as JSON on stdout; a TSDF beside it.

`python -m hsslam_bench.field_error.run SOURCE SEED [--noise kinect]`: every fourth frame is mapped
as lockstep maps it. After each, the map is asked for its distance at points of the true surface that the
second frame after it shows. Only here the map is given true poses.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from hsslam_bench.field_error.error_bins import errors_by_bin
from hsslam_bench.field_error.surface_points import SurfacePoints, surface_points, times_seen
from hsslam_bench.field_error.true_frames import TrueFrame, true_frames
from hsslam_bench.field_error.true_map import TrueMap
from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.mesh.tsdf_baseline import TsdfVolume
from hsslam_node.geometry.camera import Camera
from hsslam_node.presets import PRESETS
from hsslam_node.sources.options.source import SourceOptions

_FRAMES, _QUICK_FRAMES = 320, 24
_ASKED_AFTER = 2  # frames after a keyframe
_LEAST_SLOPE = 0.3  # of the distance, m/m: below it is no distance


def main() -> None:
    parser = argparse.ArgumentParser(prog="field_error.run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--frames", type=int, default=_FRAMES)
    parser.add_argument("--quick", action="store_true", help="a few frames")
    arguments = parser.parse_args()
    frames = _QUICK_FRAMES if arguments.quick else arguments.frames
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    print(json.dumps(field_error(PRESETS["realtime"], arguments.source, options)))


@dataclass(frozen=True)
class Asked:
    """What map and TSDF said of the points of one view."""

    points: SurfacePoints
    seen: np.ndarray  # [N] keyframes that had seen them
    sdf_m: np.ndarray  # [N] signed distance; nan: the map says nothing
    slope: np.ndarray  # [N] length of its gradient, m/m
    tsdf_m: np.ndarray | None  # [N] the TSDF's surface behind the point, along the normal

    @property
    def distance_m(self) -> np.ndarray:
        """The signed distance over its slope [N], m: how far the surface is to first order."""
        return self.sdf_m / np.maximum(self.slope, _LEAST_SLOPE)


def field_error(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """Errors by bin: of the SDF as it is, of the SDF over its slope, and of the TSDF."""
    torch.set_num_threads(1)
    found = list(ask(config, true_frames(spec, options), options.seed, _volume()))
    depth_m = np.concatenate([asked.points.depth_m for asked in found])
    seen = np.concatenate([asked.seen for asked in found])
    errors_m = {
        "sdf": [asked.sdf_m for asked in found],
        "distance": [asked.distance_m for asked in found],
        "tsdf": [asked.tsdf_m for asked in found if asked.tsdf_m is not None],
    }
    return {
        name: {
            bin: asdict(errors)
            for bin, errors in errors_by_bin(np.concatenate(parts), depth_m, seen).items()
        }
        for name, parts in errors_m.items()
        if parts
    }


def ask(
    config: SlamConfig, frames: Iterator[TrueFrame], seed: int, tsdf: TsdfVolume | None = None
) -> Iterator[Asked]:
    """Map the frames; yields what is said of one view after each keyframe."""
    every = config.keyframes.every_frames
    generator = np.random.default_rng(seed)
    keyframes: list[tuple[np.ndarray, np.ndarray]] = []
    model: TrueMap | None = None
    for index, view in enumerate(frames):
        if index % every == 0:
            if model is None:
                model = TrueMap(config, view, seed)
            else:
                model.add(view)
            keyframes.append((view.T_world_cam, view.depth_m))
            if tsdf:
                tsdf.integrate(view.frame, view.T_world_cam)
        elif index % every == _ASKED_AFTER and model is not None:
            points = surface_points(view, generator)
            far_m = config.tracker.max_depth_m
            seen = times_seen(points.world, keyframes, view.frame.camera, far_m)
            sdf_m, gradient = model.ask(points.world)
            behind_m = _behind(tsdf, view.frame.camera, view.T_world_cam, points) if tsdf else None
            slope = np.linalg.norm(gradient, axis=1)
            yield Asked(points, seen, sdf_m, slope, behind_m)


def _volume() -> TsdfVolume | None:
    try:
        return TsdfVolume()
    except UserError as error:
        print(error, file=sys.stderr)
        return None


def _behind(
    tsdf: TsdfVolume, camera: Camera, T_world_cam: np.ndarray, points: SurfacePoints
) -> np.ndarray:
    """How far the TSDF's surface lies behind the points, along their normals [N] m; nan: there is none."""
    depth_m = tsdf.depth_m(camera, T_world_cam)[points.pixel[:, 1], points.pixel[:, 0]]
    u, v = points.pixel.T
    per_depth = np.hypot(np.hypot((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy), 1.0)
    behind = (depth_m - points.depth_m) * per_depth * points.cosine
    is_told = (depth_m > 0) & (np.abs(behind) < tsdf.truncation_m)
    return np.where(is_told, behind, np.nan)


if __name__ == "__main__":
    main()
