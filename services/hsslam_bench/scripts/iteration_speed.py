"""Measures the time of one mapping iteration on real keyframes; prints JSON.

`python -m hsslam_bench.scripts.iteration_speed RAYS FREE SURFACE CHANNELS`: rays of a batch, samples of a ray
in free space and at the surface, channels of the planes. It uses one numeric thread.
"""

import argparse
import json
import statistics
import time
from dataclasses import replace

import torch

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.presets import PRESETS
from hsslam_node.rendering.ray_sampling import SamplingPattern
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_FRAMES, _QUICK_FRAMES = 80, 8  # tracked first, to get keyframes
_SETTLING, _TURNS = 20, 60  # iterations before the measurement, and measured


def main() -> None:
    parser = argparse.ArgumentParser(prog="iteration_speed", description=__doc__)
    for name in ("rays", "free", "surface", "channels"):
        parser.add_argument(name, type=int)
    parser.add_argument("--quick", action="store_true", help="a few small frames and turns")
    arguments = parser.parse_args()
    sampling = replace(
        PRESETS["realtime"].sampling,
        free_samples=arguments.free,
        surface_samples=arguments.surface,
    )
    print(
        json.dumps(iteration_speed(arguments.rays, sampling, arguments.channels, arguments.quick))
    )


def iteration_speed(
    rays: int, sampling: SamplingPattern, channels: int, quick: bool = False
) -> dict[str, float]:
    """Median and least time of `Mapper.iterate` (forward, losses, backward, Adam), ms; us a point."""
    torch.set_num_threads(1)
    realtime = PRESETS["realtime"]
    config = replace(
        realtime,
        field=replace(realtime.field, plane_channels=16 if channels == 16 else 32),
        sampling=sampling,
        mapper=replace(realtime.mapper, rays=rays),
    )
    store, first = _keyframes(realtime, quick)
    bound = initial_bound(first, config.bound, config.mapper.max_depth_m)
    layout = FieldLayout.over(config.field, bound)
    mapper = Mapper(config, FieldParameters.create(MemoryAllocator(), layout, 0), 0)
    for _ in range(2 if quick else _SETTLING):
        mapper.iterate(store)
    times_ms, points = [], 0
    for _ in range(3 if quick else _TURNS):
        start = time.perf_counter()
        report = mapper.iterate(store)
        times_ms.append(1e3 * (time.perf_counter() - start))
        points = report.rays * sampling.count
    median_ms = statistics.median(times_ms)
    return {
        "median_ms": median_ms,
        "least_ms": min(times_ms),
        "points": points,
        "us_per_point": 1e3 * median_ms / points,
        "keyframes": store.count,
    }


def _keyframes(config: SlamConfig, quick: bool) -> tuple[KeyframeStore, Frame]:
    """Keyframes of the built-in room at their tracked poses, and the first frame."""
    size = SynthOptions(width_px=160, height_px=120) if quick else SynthOptions()
    frames = _QUICK_FRAMES if quick else _FRAMES
    source = open_source("synth:room", SourceOptions(frames=frames, synth=size))
    slam = Slam(config)
    taken = [frame for frame in source.frames() if isinstance(frame, Frame)]
    for frame in taken:
        slam.process(frame)
    assert slam.store is not None
    return slam.store, taken[0]


if __name__ == "__main__":
    main()
