"""The command line of scripts that run one seed of a sequence; apart, as several scripts share it."""

import argparse

from hsslam_bench.scripts.source_with_truth import with_poor_first_map
from hsslam_node.config import SlamConfig
from hsslam_node.presets import PRESETS
from hsslam_node.sources.options.source import SourceOptions


def sequence_arguments(
    prog: str, purpose: str | None, quick_frames: int
) -> tuple[SlamConfig, str, SourceOptions]:
    """Parse `SOURCE SEED [--noise kinect] [--frames N] [--quick]` to configuration, source and options."""
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--frames", type=int, help="use the first N frames")
    parser.add_argument("--quick", action="store_true", help="few frames, a poor first map")
    arguments = parser.parse_args()
    config, frames = PRESETS["realtime"], arguments.frames
    if arguments.quick:
        config, frames = with_poor_first_map(config), quick_frames
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    return config, arguments.source, options
