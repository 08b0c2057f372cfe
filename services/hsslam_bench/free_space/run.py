"""Measures the errors of distances in observed free space against the true mesh; prints JSON.

`python -m hsslam_bench.free_space.run SOURCE SEED [--noise kinect] [--poses tracked|true]` tracks and maps
the frames in lockstep, then measures the distances of the kept keyframes. With `--poses true` it takes every
fourth frame at its true pose instead, without tracking and map.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from hsslam_bench.field_error.true_frames import TrueFrame, true_frames
from hsslam_bench.free_space.distance_errors import distance_errors, free_points, true_distances
from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.distance.distance_meter import FAR_M, DistanceMeter
from hsslam_node.distance.floor_plane import find_floor
from hsslam_node.distance.whole_map import whole_map
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions

_POINTS = 200_000
_QUICK_FRAMES = 40


@dataclass(frozen=True)
class Seen:
    """The keyframes for a map of distances."""

    camera: Camera
    views: Sequence[tuple[np.ndarray, np.ndarray]]  # depth [H, W] float32 m, T_world_cam [4, 4]
    map: DenseMap | None  # None at true poses


def main() -> None:
    parser = argparse.ArgumentParser(prog="free_space.run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--poses", choices=("tracked", "true"), default="tracked")
    parser.add_argument("--voxel-m", type=float, default=0.05)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--quick", action="store_true", help="a few frames")
    arguments = parser.parse_args()
    frames = _QUICK_FRAMES if arguments.quick else arguments.frames
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    torch.set_num_threads(1)
    config = PRESETS["realtime"]
    look = tracked_views if arguments.poses == "tracked" else true_views
    seen = look(config, arguments.source, options)
    print(json.dumps(free_space(seen, arguments.source, options, arguments.voxel_m)))


def free_space(seen: Seen, spec: str, options: SourceOptions, voxel_m: float) -> dict[str, Any]:
    """Errors at points of free space: "certain", where all nearer space was seen; "queried", the answers of
    the map where all nearer space was seen by its own voxels, which lie along other axes; "all" points."""
    _, truth = source_with_truth(spec, options)
    mesh = truth.mesh()
    if mesh is None:
        raise UserError(f"source {spec}: expected a true mesh")
    floor = find_floor(seen.views, seen.camera)
    distances = DistanceMeter().measure(whole_map(seen.views, seen.camera, floor, voxel_m))
    points = free_points(distances, _POINTS, options.seed)
    true = true_distances(points, mesh, inverse(truth.T_world_cam[0]))
    certain, found = distances.is_certain(points), distances.query(points)
    errors = {
        "certain": distance_errors(found, true, FAR_M, certain),
        "all": distance_errors(found, true, FAR_M, found.known),
    }
    if seen.map is not None:
        answers, is_judged = seen.map.query(points), seen.map.distances().is_certain(points)
        errors["queried"] = distance_errors(answers, true, FAR_M, is_judged & answers.known)
    return {
        "up": floor.source,
        "keyframes": len(seen.views),
        **{name: asdict(its) for name, its in errors.items()},
    }


def true_views(config: SlamConfig, spec: str, options: SourceOptions) -> Seen:
    """Every n-th frame at its true pose; n: frames from keyframe to keyframe."""
    every = config.keyframes.every_frames
    found: list[TrueFrame] = [
        view for index, view in enumerate(true_frames(spec, options)) if index % every == 0
    ]
    views = [(view.frame.depth_m(), view.T_world_cam) for view in found]
    return Seen(found[0].frame.camera, views, None)


def tracked_views(config: SlamConfig, spec: str, options: SourceOptions) -> Seen:
    """The keyframes that the library keeps at their tracked poses, and its map."""
    slam = Slam(config, seed=options.seed)
    source, _ = source_with_truth(spec, options)
    for frame in source.frames():
        if not isinstance(frame, Frame):
            raise UserError(f"frame {frame.index}: {frame.reason}")
        slam.process(frame)
    slam.finish()
    store = slam.store
    assert store is not None
    kept = store.kept()
    poses = store.poses_of(kept)
    views = [(store.frame(int(k)).depth_m(), T) for k, T in zip(kept, poses, strict=True)]
    return Seen(store.camera, views, slam.map)


if __name__ == "__main__":
    main()
