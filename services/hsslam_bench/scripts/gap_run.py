"""Tracks a camera that misses stretches of frames, in a process of its own; prints JSON.

`python -m hsslam_bench.scripts.gap_run SOURCE SEED [--noise kinect] [--frames N]` shows stretches of 8 to 15
frames, and leaves out 4 to 30 frames between them.
"""

import json
from dataclasses import asdict
from typing import Any

import torch

from hsslam_bench.scripts.sequence_arguments import sequence_arguments
from hsslam_bench.scripts.source_with_truth import published, source_with_truth
from hsslam_node.config import SlamConfig
from hsslam_node.evaluation.trajectory.gaps import gap_plan, gap_score
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions

_QUICK_FRAMES = 60


def main() -> None:
    print(json.dumps(gap_run(*sequence_arguments("gap_run", __doc__, _QUICK_FRAMES))))


def gap_run(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """The score for the seed of the options."""
    torch.set_num_threads(1)
    source, truth = source_with_truth(spec, options)
    plan = gap_plan(truth.T_world_cam, options.seed)
    shown = frozenset(plan.order)
    frames = (frame for at, frame in enumerate(source.frames()) if at in shown)
    poses = published(Slam(config, options.seed), frames)
    return asdict(gap_score(plan, poses.tracked, poses.T_world_cam, truth.T_world_cam))


if __name__ == "__main__":
    main()
