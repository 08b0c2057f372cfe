"""Measures speed and accuracy of one preset in one process; prints JSON.

`python -m hsslam_bench.scripts.preset_speed PRESET SOURCE FRAMES` tracks and maps each frame in turn, so that
no preset gains by skipping work.
"""

import argparse
import json
import time
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from hsslam_bench.scripts.source_with_truth import with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.warm_start import warm_start

_QUICK_FRAMES = 3
_GPU_SETTLING = 30  # frames


def main() -> None:
    parser = argparse.ArgumentParser(prog="preset_speed", description=__doc__)
    parser.add_argument("preset")
    parser.add_argument("source")
    parser.add_argument("frames", type=int)
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--quick", action="store_true", help="a few frames, a poor first map")
    parser.add_argument("--threads", type=int, default=1, help="number of CPU threads")
    arguments = parser.parse_args()
    config = _preset(arguments.preset)
    frames = arguments.frames
    if arguments.quick:
        config, frames = with_poor_first_map(config), min(frames, _QUICK_FRAMES)
    device = replace(choose_device(arguments.device), threads=arguments.threads)
    print(json.dumps(preset_speed(config, arguments.source, frames, device)))


def preset_speed(config: SlamConfig, source: str, frames: int, device: Device) -> dict[str, Any]:
    """Frames per second without the first frame, which makes the first map; ATE of frames that are not lost.

    The time excludes reading images and, on a GPU, the first frames, during which kernels are compiled.
    """
    torch.set_num_threads(1)
    options = SourceOptions(frames=frames)
    truth = open_ground_truth(source, options)
    warm_start(config, device)  # load compiled kernels first, for all presets
    slam = Slam(config, device=device)
    seconds, stamps_ns, results = [], [], []
    for frame in open_source(source, options).frames():
        assert isinstance(frame, Frame)
        start = time.perf_counter()
        results.append(slam.process(frame))
        seconds.append(time.perf_counter() - start)
        stamps_ns.append(frame.stamp_ns)
    assert slam.store is not None and truth is not None
    T_world_keyframe = slam.store.poses()
    tracked = np.array([result.status != "lost" for result in results])
    final = np.array([T_world_keyframe[r.keyframe] @ r.T_keyframe_cam for r in results])
    error = ate(
        Trajectory(np.array(stamps_ns)[tracked], final[tracked]),
        Trajectory(truth.stamps_ns, truth.T_world_cam),
    )
    first = min(_GPU_SETTLING, len(seconds) // 2) if device.uses_triton else 1
    return {
        "fps": (len(seconds) - first) / sum(seconds[first:]),
        "first_s": seconds[0],
        "rmse_m": error.rmse_m,
        "scored": error.scored,
        "lost": sum(result.status == "lost" for result in results),
        "device": str(device),
    }


def _preset(name: str) -> SlamConfig:
    configs = {str(known): config for known, config in PRESETS.items()}
    if name not in configs:
        raise UserError(f"preset {name}: expected one of {', '.join(configs)}")
    return configs[name]


if __name__ == "__main__":
    main()
