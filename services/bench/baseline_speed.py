"""Speed and accuracy of one preset in one process, as JSON on stdout.

`python -m hsslam_node.services.bench.baseline_speed PRESET SOURCE FRAMES`, alone, one numeric thread:
tracking and mapping of a frame one after the other, so that no preset gains by leaving work out.
"""

import argparse
import json
import time

import numpy as np
import torch

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ate import ate
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import SourceOptions


def main() -> None:
    parser = argparse.ArgumentParser(prog="baseline_speed", description=__doc__)
    parser.add_argument("preset")
    parser.add_argument("source")
    parser.add_argument("frames", type=int)
    parser.add_argument("--quick", action="store_true", help="a few frames")
    arguments = parser.parse_args()
    frames = min(arguments.frames, 3) if arguments.quick else arguments.frames
    print(json.dumps(baseline_speed(arguments.preset, arguments.source, frames)))


def baseline_speed(preset: str, source: str, frames: int) -> dict[str, float]:
    """Frames per second after the first (its map is made once), and ATE over all of them.

    Reading the images is not counted.

    Raises:
        UserError: there is no such preset.
    """
    torch.set_num_threads(1)
    configs = {str(name): config for name, config in PRESETS.items()}
    if preset not in configs:
        raise UserError(f"preset {preset}: expected one of {', '.join(configs)}")
    options = SourceOptions(frames=frames)
    truth = open_ground_truth(source, options)
    slam = Slam(configs[preset])
    seconds, stamps_ns, results = [], [], []
    for frame in open_source(source, options).frames():
        assert isinstance(frame, Frame)
        start = time.perf_counter()
        results.append(slam.process(frame))
        seconds.append(time.perf_counter() - start)
        stamps_ns.append(frame.stamp_ns)
    assert slam.store is not None and truth is not None
    T_world_keyframe = slam.store.poses()
    final = np.array([T_world_keyframe[r.keyframe] @ r.T_keyframe_cam for r in results])
    error = ate(
        Trajectory(np.array(stamps_ns), final), Trajectory(truth.stamps_ns, truth.T_world_cam)
    )
    return {
        "fps": (len(seconds) - 1) / sum(seconds[1:]),
        "first_s": seconds[0],
        "rmse_m": error.rmse_m,
        "scored": error.scored,
        "lost": sum(result.status == "lost" for result in results),
    }


if __name__ == "__main__":
    main()
