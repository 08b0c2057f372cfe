"""A camera whose frames are missing now and then, in one process, as JSON on stdout.

`python -m hsslam_bench.scripts.gap_run SOURCE SEED [--noise kinect] [--frames N]`: stretches of 8 to
15 frames with gaps of 4 to 30 between them.
"""

import argparse
import json
from dataclasses import asdict
from typing import Any

import torch

from hsslam_bench.scripts.source_with_truth import published, source_with_truth, with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.evaluation.trajectory.gaps import gap_plan, gap_score
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.options import SourceOptions

_QUICK_FRAMES = 60


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
        config, frames = with_poor_first_map(config), _QUICK_FRAMES
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    print(json.dumps(gap_run(config, arguments.source, options)))


def gap_run(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """The score of one seed, that of the options."""
    torch.set_num_threads(1)
    source, truth = source_with_truth(spec, options)
    plan = gap_plan(truth.T_world_cam, options.seed)
    shown = frozenset(plan.order)
    frames = (frame for at, frame in enumerate(source.frames()) if at in shown)
    poses = published(Slam(config, options.seed), frames)
    return asdict(gap_score(plan, poses.tracked, poses.T_world_cam, truth.T_world_cam))


if __name__ == "__main__":
    main()
