"""Localises a camera in a saved map, in one process; prints JSON.

`python -m hsslam_bench.scripts.localise_run SOURCE SEED` saves a map of the first half of the sequence, and
localises the second half with that file alone.
"""

import argparse
import json
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hsslam_bench.scripts.source_with_truth import source_with_truth, with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.evaluation.trajectory.localisation import (
    localisation_score,
    map_in_truth,
    overlaps,
)
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint, save_checkpoint
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions

_QUICK_FRAMES = 24


def main() -> None:
    parser = argparse.ArgumentParser(prog="localise_run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--quick", action="store_true", help="few frames, a poor first map")
    arguments = parser.parse_args()
    config, options = PRESETS["realtime"], SourceOptions(seed=arguments.seed)
    if arguments.quick:
        config, options = with_poor_first_map(config), replace(options, frames=_QUICK_FRAMES)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.safetensors"
        print(json.dumps(localise_run(config, arguments.source, options, path)))


def localise_run(
    config: SlamConfig, spec: str, options: SourceOptions, path: Path
) -> dict[str, Any]:
    """The score for the seed of the options, and whether the map has changed; saves the map at `path`."""
    torch.set_num_threads(1)
    _, truth = source_with_truth(spec, options)
    count = len(truth.T_world_cam)
    half = count // 2
    _map(config, spec, replace(options, frames=half), path)
    before, saved = path.read_bytes(), load_checkpoint(path)
    slam = Slam(config, options.seed, saved_map=path, localise_only=True)
    assert slam.store and slam.parameters
    params = slam.parameters.params.copy()
    frames = _frames(spec, replace(options, start=half, frames=count - half))
    found = [(f.stamp_ns, r) for f, r in zip(frames, slam.run(frames), strict=True)]
    tracked = [(stamp, r.T_world_cam) for stamp, r in found if r.status != "lost"]
    estimate = Trajectory(
        np.array([stamp for stamp, _ in tracked], np.int64),
        np.array([T for _, T in tracked]).reshape(-1, 4, 4),
    )
    of_map = Trajectory(saved.keyframe_stamps_ns, saved.T_world_keyframe)
    later = Trajectory(truth.stamps_ns[half:], truth.T_world_cam[half:])
    seen = overlaps(frames, later.T_world_cam, _views(saved, truth.trajectory))
    score = localisation_score(estimate, later, seen, map_in_truth(of_map, truth.trajectory))
    return {
        **asdict(score),
        "all_within": score.all_within,
        "map_unchanged": path.read_bytes() == before
        and slam.store.count == slam.store.inherited
        and bool((slam.parameters.params == params).all()),
        "map_bytes": len(before),
    }


def _map(config: SlamConfig, spec: str, options: SourceOptions, path: Path) -> None:
    slam = Slam(config, options.seed)
    for frame in _frames(spec, options):
        slam.process(frame)
    slam.finish()
    save_checkpoint(path, map_snapshot(slam.store, slam.parameters, config))


def _frames(spec: str, options: SourceOptions) -> list[Frame]:
    return [frame for frame in open_source(spec, options).frames() if isinstance(frame, Frame)]


def _views(saved: MapCheckpoint, truth: Trajectory) -> Views:
    """The map's keyframes at their true poses."""
    assert saved.images is not None and saved.camera is not None
    pose_of = dict(zip(truth.stamps_ns.tolist(), truth.T_world_cam, strict=True))
    poses = np.stack([pose_of[stamp] for stamp in saved.keyframe_stamps_ns.tolist()])
    depths = np.stack([saved.images.pixels(k)[1] for k in range(len(saved.images))])
    units_per_m = np.float32(saved.images.depth_units_per_m)
    return Views(saved.camera, poses, depths.astype(np.float32) / units_per_m)


if __name__ == "__main__":
    main()
