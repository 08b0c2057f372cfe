"""Measures the stages of tracking; prints JSON: stage -> mean ms.

`python -m hsslam_bench.scripts.tracking_stages [--noise kinect]` uses one numeric thread.
"""

import argparse
import cProfile
import inspect
import json
import pstats
from collections.abc import Callable
from typing import Any, Literal

from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.aligned.observation import Observation
from hsslam_node.tracking.aligned.reference_aligner import ReferenceAligner
from hsslam_node.tracking.keyframes.reference_keyframe import reference_keyframe
from hsslam_node.tracking.tracker import Tracker

_FRAMES, _QUICK_FRAMES = 120, 8
_FIRST = 4  # frames to skip: caches and lazy imports
_FRAME_STAGES: dict[str, Callable[..., Any]] = {  # the result is ms a frame
    "track": Tracker.track,
    "observe": Observation.of,
    "align": ReferenceAligner.align,
}
_CALL_STAGES: dict[str, Callable[..., Any]] = {  # the result is ms a call
    "keyframe": KeyframeStore.append,
    "reference": reference_keyframe,
    "mapping iteration": Mapper.iterate,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="tracking_stages", description=__doc__)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--quick", action="store_true", help="a few small frames")
    arguments = parser.parse_args()
    print(json.dumps(tracking_stages(arguments.noise, arguments.quick)))


def tracking_stages(
    noise: Literal["none", "kinect"] = "none", quick: bool = False
) -> dict[str, float]:
    """Mean ms of each stage over a run of the library on the built-in room."""
    size = SynthOptions(width_px=160, height_px=120) if quick else SynthOptions()
    frames = _QUICK_FRAMES if quick else _FRAMES
    source = open_source("synth:room", SourceOptions(noise=noise, frames=frames, synth=size))
    slam = Slam(PRESETS["realtime"])
    profile = cProfile.Profile()  # its overhead is below 1 %, with a few hundred calls a frame
    for index, frame in enumerate(f for f in source.frames() if isinstance(f, Frame)):
        if index >= _FIRST:
            profile.enable()
        slam.process(frame)
        profile.disable()
    return _means(profile, frames - _FIRST)


def _means(profile: cProfile.Profile, frames: int) -> dict[str, float]:
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    found = {}
    for stage, function in _FRAME_STAGES.items():
        found[stage] = 1e3 * stats[_key(function)][3] / frames
    for stage, function in _CALL_STAGES.items():
        calls, cumulative_s = stats[_key(function)][1], stats[_key(function)][3]
        found[stage] = 1e3 * cumulative_s / calls
    return found


def _key(function: Callable[..., Any]) -> tuple[str, int, str]:
    """What the profiler calls a function."""
    code = inspect.unwrap(getattr(function, "__func__", function)).__code__
    return code.co_filename, code.co_firstlineno, code.co_name


if __name__ == "__main__":
    main()
