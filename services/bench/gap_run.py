"""A camera whose frames are missing now and then, in one process, as JSON on stdout.

`python -m hsslam_node.services.bench.gap_run SOURCE SEED [--noise kinect] [--frames N]`: stretches of 8 to
15 frames with gaps of 4 to 30 between them.
"""

import argparse
import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.gaps import gap_plan, gap_score
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import SourceOptions

_QUICK_FRAMES, _QUICK_ITERATIONS = 60, 3


def main() -> None:
    parser = argparse.ArgumentParser(prog="gap_run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--frames", type=int, help="of the sequence, the first")
    parser.add_argument("--quick", action="store_true", help="few frames, a poor first map")
    arguments = parser.parse_args()
    config, frames = PRESETS["realtime"], arguments.frames
    if arguments.quick:
        config = replace(config, mapper=replace(config.mapper, first_iterations=_QUICK_ITERATIONS))
        frames = _QUICK_FRAMES
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    print(json.dumps(gap_run(config, arguments.source, options)))


def gap_run(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """The score of one seed, that of the options."""
    torch.set_num_threads(1)
    truth = open_ground_truth(spec, options)
    source = open_source(spec, options)
    if truth is None or source.frame_count is None or len(truth.T_world_cam) != source.frame_count:
        raise UserError(f"source {spec}: expected a true pose for every frame")
    plan = gap_plan(truth.T_world_cam, options.seed)
    shown = frozenset(plan.order)
    slam = Slam(config, options.seed)
    results = []
    for at, frame in enumerate(source.frames()):
        if at not in shown:
            continue
        if not isinstance(frame, Frame):
            raise UserError(f"source {spec}: {frame.reason}")
        results.append(slam.process(frame))
    tracked = np.array([r.status != "lost" for r in results])
    T_estimate = np.stack([r.T_world_cam for r in results])
    return asdict(gap_score(plan, tracked, T_estimate, truth.T_world_cam))


if __name__ == "__main__":
    main()
