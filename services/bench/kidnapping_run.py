"""A camera carried to places seen before, in one process, as JSON on stdout.

`python -m hsslam_node.services.bench.kidnapping_run SOURCE SEED [--noise kinect]`: every second frame
builds the map, then the frames between them are shown from twenty random places on, twelve each.
"""

import argparse
import json
import time
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.kidnapping import kidnapping_plan, kidnapping_score
from hsslam_node.frame import Frame
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.reordered import Reordered
from hsslam_node.sources.source import SourceOptions

_QUICK_FRAMES, _QUICK_JUMPS, _QUICK_ITERATIONS = 60, 1, 3


def main() -> None:
    parser = argparse.ArgumentParser(prog="kidnapping_run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--quick", action="store_true", help="one jump, a poor first map")
    arguments = parser.parse_args()
    config, options, jumps = PRESETS["realtime"], SourceOptions(noise=arguments.noise), 20
    options = replace(options, seed=arguments.seed)
    if arguments.quick:
        config = replace(config, mapper=replace(config.mapper, first_iterations=_QUICK_ITERATIONS))
        options, jumps = replace(options, frames=_QUICK_FRAMES), _QUICK_JUMPS
    print(json.dumps(kidnapping_run(config, arguments.source, options, jumps)))


def kidnapping_run(
    config: SlamConfig, spec: str, options: SourceOptions, jumps: int = 20
) -> dict[str, Any]:
    """The score of one seed (that of the options), and how long lost frames took."""
    torch.set_num_threads(1)
    truth = open_ground_truth(spec, options)
    source = open_source(spec, options)
    if truth is None or len(truth.T_world_cam) != source.frame_count:
        raise UserError(f"source {spec}: expected a true pose for every frame")
    plan = kidnapping_plan(truth.T_world_cam, options.seed, jumps)
    slam = Slam(config, options.seed)
    results, took_s = [], []
    for frame in Reordered(source, plan.order).frames():
        if not isinstance(frame, Frame):
            raise UserError(f"source {spec}: {frame.reason}")
        start = time.perf_counter()
        results.append(slam.process(frame))
        took_s.append(time.perf_counter() - start)
    tracked = np.array([r.status != "lost" for r in results])
    T_estimate = np.stack([r.T_world_cam for r in results])
    score = kidnapping_score(plan, tracked, T_estimate, truth.T_world_cam)
    lost_ms = 1e3 * np.array(took_s)[~tracked]
    slowest_ms = float(lost_ms.max()) if len(lost_ms) else 0.0
    return {**asdict(score), "lost": len(lost_ms), "slowest_lost_ms": slowest_ms}


if __name__ == "__main__":
    main()
