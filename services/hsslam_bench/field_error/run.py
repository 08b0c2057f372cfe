"""Measures the error at true surfaces of a map and of a TSDF, both made at true poses; prints JSON.

`python -m hsslam_bench.field_error.run SOURCE SEED [--noise kinect]` maps every fourth frame as lockstep
does. After each of these keyframes it queries the map's distance at points of the true surface that the
second frame after it shows.
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
_QUERY_AFTER = 2  # frames after a keyframe
_LEAST_SLOPE = 0.3  # of the SDF, m/m; a smaller slope counts as this


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
    """Values of map and TSDF at the points of one view."""

    points: SurfacePoints
    seen: np.ndarray  # [N] number of keyframes that saw each point
    sdf_m: np.ndarray  # [N] signed distance; nan: the map has no value
    slope: np.ndarray  # [N] length of its gradient, m/m
    tsdf_m: np.ndarray | None  # [N] distance of the TSDF's surface behind each point

    @property
    def distance_m(self) -> np.ndarray:
        """The SDF over its slope [N], m: the distance of the surface to first order."""
        return self.sdf_m / np.maximum(self.slope, _LEAST_SLOPE)


def field_error(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """Errors by bin of the SDF, of the SDF over its slope, and of the TSDF."""
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
    """Map the frames; yields the values at the points of one view after each keyframe."""
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
        elif index % every == _QUERY_AFTER and model is not None:
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
    """Distance of the TSDF's surface behind the points, along their normals [N], m; nan: no surface."""
    depth_m = tsdf.depth_m(camera, T_world_cam)[points.pixel[:, 1], points.pixel[:, 0]]
    u, v = points.pixel.T
    per_depth = np.hypot(np.hypot((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy), 1.0)
    behind = (depth_m - points.depth_m) * per_depth * points.cosine
    is_known = (depth_m > 0) & (np.abs(behind) < tsdf.truncation_m)
    return np.where(is_known, behind, np.nan)


if __name__ == "__main__":
    main()
