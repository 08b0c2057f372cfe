"""Measures the stages of tracking; prints JSON: stage -> mean ms.

`python -m hsslam_bench.scripts.tracking_stages` uses one numeric thread.
"""

import argparse
import cProfile
import json
import pstats

from hsslam_node.frame import Frame
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_FRAMES, _QUICK_FRAMES = 120, 8
_FIRST = 4  # frames to skip: caches and lazy imports
_FRAME_STAGES = {  # one call a frame; the result is ms a frame
    "track": ("tracker.py", "track"),
    "pyramid": ("reference_keyframe.py", "grey_pyramid"),
    "points": ("tracker.py", "_points"),
    "align": ("alignment.py", "align"),
}
_CALL_STAGES = {  # in some frames only; the result is ms a call
    "keyframe": ("store.py", "append"),
    "reference": ("reference_keyframe.py", "reference_keyframe"),
    "odometry": ("odometry.py", "rgbd_odometry"),
    "mapping iteration": ("mapper.py", "iterate"),
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="tracking_stages", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few small frames")
    print(json.dumps(tracking_stages(parser.parse_args().quick)))


def tracking_stages(quick: bool = False) -> dict[str, float]:
    """Mean ms of each stage over a run of the library on the built-in room."""
    size = SynthOptions(width_px=160, height_px=120) if quick else SynthOptions()
    frames = _QUICK_FRAMES if quick else _FRAMES
    source = open_source("synth:room", SourceOptions(frames=frames, synth=size))
    slam = Slam(PRESETS["realtime"])
    profile = cProfile.Profile()  # its overhead is below 1 %, with a few hundred calls a frame
    for index, frame in enumerate(f for f in source.frames() if isinstance(f, Frame)):
        if index >= _FIRST:
            profile.enable()
        slam.process(frame)
        profile.disable()
    return _means(profile, frames - _FIRST)


def _means(profile: cProfile.Profile, frames: int) -> dict[str, float]:
    found = {}
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    by_function = {(path.rpartition("/")[2], name): row for (path, _, name), row in stats.items()}
    for stage, function in _FRAME_STAGES.items():
        if function in by_function:
            found[stage] = 1e3 * by_function[function][3] / frames
    for stage, function in _CALL_STAGES.items():
        if function in by_function:
            calls, cumulative_s = by_function[function][1], by_function[function][3]
            found[stage] = 1e3 * cumulative_s / calls
    return found


if __name__ == "__main__":
    main()
