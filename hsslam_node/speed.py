"""Speed on the device at hand: `python -m hsslam_node.speed`.

For each preset, on the built-in room: mapping iterations per second over ten keyframes, and frames per
second of tracking and mapping in one process, without the first frame and its initial map.
"""

import argparse
import dataclasses
import json
import statistics
import sys
import time
from dataclasses import dataclass

from hsslam_node.config import SlamConfig
from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.presets import PRESETS, PresetName
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_PRESETS = ("paper", "realtime")
_WARM_UP = 10  # iterations: compiled kernels, graphs captured
_FIRST_ITERATIONS = 100  # of the initial map: enough for tracking


@dataclass(frozen=True)
class PresetSpeed:
    """Speed of one preset."""

    preset: PresetName
    iteration_ms: float  # median of mapping iterations
    iterations_per_s: float
    frames_per_s: float
    lost: int  # of the frames
    frames: int


def measure(
    preset: PresetName, config: SlamConfig, device: Device, frames: list[Frame]
) -> PresetSpeed:
    """Run the frames, then iterate on the map that they left."""
    few = min(config.mapper.first_iterations, _FIRST_ITERATIONS)
    mapper = dataclasses.replace(config.mapper, first_iterations=few)
    slam = Slam(dataclasses.replace(config, mapper=mapper), device=device)
    slam.process(frames[0])
    start = time.perf_counter()
    lost = sum(result.status == "lost" for result in slam.run(frames[1:]))
    frames_per_s = (len(frames) - 1) / (time.perf_counter() - start)
    iteration_s = _iteration_s(slam, device)
    return PresetSpeed(preset, 1e3 * iteration_s, 1 / iteration_s, frames_per_s, lost, len(frames))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m hsslam_node.speed")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--presets", nargs="+", choices=_PRESETS, default=_PRESETS)
    parser.add_argument("--frames", type=int, default=81, help="frames of the built-in room")
    parser.add_argument("--json", action="store_true", help="one line of JSON instead of text")
    options = parser.parse_args()
    try:
        device = choose_device(options.device)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    room = SourceOptions(frames=options.frames, synth=SynthOptions())
    frames = [f for f in open_source("synth:room", room).frames() if isinstance(f, Frame)]
    found = [measure(name, PRESETS[name], device, frames) for name in options.presets]
    if options.json:
        speeds = [dataclasses.asdict(speed) for speed in found]
        print(json.dumps({"device": dataclasses.asdict(device), "speeds": speeds}))
        return
    print(f"device: {device}")
    for speed in found:
        m, S = PRESETS[speed.preset].mapper, PRESETS[speed.preset].sampling.count
        print(
            f"{speed.preset}: iteration of {m.rays} x {S} in {speed.iteration_ms:.2f} ms, "
            f"{speed.iterations_per_s:.1f} iterations/s; {speed.frames_per_s:.1f} frames/s, "
            f"{speed.lost} of {speed.frames} lost"
        )


def _iteration_s(slam: Slam, device: Device, least_s: float = 3.0) -> float:
    """Median over iterations of `least_s` in all; on a GPU the host draws the next one meanwhile."""
    assert slam.parameters and slam.store
    mapper = Mapper(slam.config, slam.parameters, 0, device)
    for _ in range(_WARM_UP):
        mapper.iterate(slam.store)
    took: list[float] = []
    while sum(took) < least_s:
        start = time.perf_counter()
        mapper.iterate(slam.store)
        took.append(time.perf_counter() - start)
    return statistics.median(took)


if __name__ == "__main__":
    main()
