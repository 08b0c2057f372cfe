"""Relocalises a camera that is carried to places seen before, in one process; prints JSON.

`python -m hsslam_bench.scripts.kidnapping_run SOURCE SEED [--noise kinect]` builds the map from every second
frame. Then it jumps twenty times to a random place and shows twelve of the other frames from there.
"""

import argparse
import json
from dataclasses import asdict, replace
from typing import Any

import torch

from hsslam_bench.scripts.source_with_truth import published, source_with_truth, with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.evaluation.trajectory.kidnapping import kidnapping_plan, kidnapping_score
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reordered import Reordered

_QUICK_FRAMES, _QUICK_JUMPS = 160, 1  # kitchen offers no jump in 120


def main() -> None:
    parser = argparse.ArgumentParser(prog="kidnapping_run", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--quick", action="store_true", help="one jump, a poor first map")
    arguments = parser.parse_args()
    config, jumps = PRESETS["realtime"], 20
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed)
    if arguments.quick:
        config, jumps = with_poor_first_map(config), _QUICK_JUMPS
        options = replace(options, frames=_QUICK_FRAMES)
    print(json.dumps(kidnapping_run(config, arguments.source, options, jumps)))


def kidnapping_run(
    config: SlamConfig, spec: str, options: SourceOptions, jumps: int = 20
) -> dict[str, Any]:
    """The score for the seed of the options, and the number and slowest time of lost frames."""
    torch.set_num_threads(1)
    source, truth = source_with_truth(spec, options)
    plan = kidnapping_plan(truth.T_world_cam, options.seed, jumps)
    poses = published(Slam(config, options.seed), Reordered(source, plan.order).frames())
    score = kidnapping_score(plan, poses.tracked, poses.T_world_cam, truth.T_world_cam)
    lost_ms = 1e3 * poses.took_s[~poses.tracked]
    return {**asdict(score), "lost": len(lost_ms), "slowest_lost_ms": lost_ms.max(initial=0.0)}


if __name__ == "__main__":
    main()
