"""Whether poses are as sure as they say, in one process, as JSON on stdout.

`python -m hsslam_bench.scripts.covariance_run SOURCE SEED [--noise kinect] [--frames N]`
"""

import argparse
import json
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from hsslam_bench.scripts.source_with_truth import source_with_truth, with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.trajectory.calibration import calibration
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.options import SourceOptions

_QUICK_FRAMES = 20


def main() -> None:
    parser = argparse.ArgumentParser(prog="covariance_run", description=__doc__)
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
    print(json.dumps(covariance_run(config, arguments.source, options)))


def covariance_run(config: SlamConfig, spec: str, options: SourceOptions) -> dict[str, Any]:
    """The calibration of one seed, that of the options: all tracked frames but the first."""
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
