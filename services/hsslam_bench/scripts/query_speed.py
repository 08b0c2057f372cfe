"""Measures how many points a second a map answers; prints JSON.

`python -m hsslam_bench.scripts.query_speed` uses one numeric thread. Times are process times.
"""

import argparse
import json
import statistics
import time

import numpy as np
import torch

from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import world_points
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_FRAMES, _QUICK_FRAMES = 60, 6
_POINTS, _QUICK_POINTS = 1_000_000, 10_000
_AT_ONCE = 100_000  # most points of a request
_TURNS = 5  # the result is their median


def main() -> None:
    parser = argparse.ArgumentParser(prog="query_speed", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few small frames and points")
    print(json.dumps(query_speed(parser.parse_args().quick)))


def query_speed(quick: bool = False) -> dict[str, float]:
    """Points a second with distance, gradient, known and certainty, near surfaces, in random order.

    `first_s`: time of the first query, which reads the depth of `keyframes` keyframes.
    """
    torch.set_num_threads(1)
    slam, points = _map_and_points(quick)
    start = time.process_time()
    slam.query(points[:1])
    first_s = time.process_time() - start
    rates, near = [], 0.0
    for _ in range(1 if quick else _TURNS):
        start = time.process_time()
        for k in range(0, len(points), _AT_ONCE):
            found = slam.query(points[k : k + _AT_ONCE])
            near = float(np.any(found.gradient, axis=1).mean())
        rates.append(len(points) / (time.process_time() - start))
    return {
        "points_per_s": statistics.median(rates),
        "with_gradient": near,
        "first_s": first_s,
        "keyframes": float(len(slam.map.keyframes)),
    }


def _map_and_points(quick: bool) -> tuple[Slam, np.ndarray]:
    """A map of the built-in room, and points [N, 3] m within 4 cm of the depth of its keyframes."""
    size = SynthOptions(width_px=160, height_px=120) if quick else SynthOptions()
    frames = _QUICK_FRAMES if quick else _FRAMES
    slam = Slam(PRESETS["realtime"])
    for frame in open_source("synth:room", SourceOptions(frames=frames, synth=size)).frames():
        if isinstance(frame, Frame):
            slam.process(frame)
    keyframes, rng = slam.map.keyframes, np.random.default_rng(0)
    surface = np.concatenate(
        [world_points(depth_m, keyframes.camera, T, 2) for depth_m, T in keyframes.views]
    )
    points = rng.choice(surface, _QUICK_POINTS if quick else _POINTS)
    return slam, points + rng.uniform(-0.02, 0.02, points.shape)


if __name__ == "__main__":
    main()
