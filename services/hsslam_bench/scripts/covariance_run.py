"""Measures the calibration of the covariances of poses, in one process; prints JSON.

`python -m hsslam_bench.scripts.covariance_run SOURCE SEED [--noise kinect] [--frames N]`
"""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from hsslam_bench.scripts.sequence_arguments import sequence_arguments
from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.trajectory.calibration import calibration
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions

_QUICK_FRAMES = 20


def main() -> None:
    print(json.dumps(covariance_run(*sequence_arguments("covariance_run", __doc__, _QUICK_FRAMES))))


def covariance_run(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """The calibration over all tracked frames except the first, for the seed of the options."""
    torch.set_num_threads(1)
    source, truth = source_with_truth(spec, options)
    slam = Slam(config, options.seed)
    results = []
    for frame in source.frames():
        if not isinstance(frame, Frame):
            raise UserError(f"frame {frame.index}: {frame.reason}")
        results.append(slam.process(frame))
    tracked = [k for k, result in enumerate(results) if result.status == "tracked"]
    covariances = [results[k].covariance for k in tracked]
    T_truth = inverse(truth.T_world_cam[0]) @ truth.T_world_cam
    found = calibration(
        np.stack([results[k].T_world_cam for k in tracked]),
        T_truth[tracked],
        np.stack([one for one in covariances if one is not None]),
    )
    return asdict(found)


if __name__ == "__main__":
    main()
