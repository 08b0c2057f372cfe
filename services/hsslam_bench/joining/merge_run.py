"""Compares two merged sessions with one run over all frames, in one process; prints JSON.

`python -m hsslam_bench.joining.merge_run SOURCE SEED` runs a session over the first 55 % of the sequence, one
over the last 55 %, which has its own world, and one over all frames.
"""

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hsslam_bench.scripts.sequence_arguments import sequence_arguments
from hsslam_bench.scripts.source_with_truth import published, source_with_truth
from hsslam_node.config import SlamConfig
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.merging.carried_trajectory import carried, joined
from hsslam_node.merging.merge_maps import merge_maps
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions

_SHARE = 0.55  # of the frames, for each session
_QUICK_FRAMES = 120


def main() -> None:
    config, source, options = sequence_arguments("merge_run", __doc__, _QUICK_FRAMES)
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(merge_run(config, source, options, Path(folder))))


def merge_run(
    config: SlamConfig, spec: str, options: SourceOptions, folder: Path
) -> dict[str, Any]:
    """ATE (m) of the whole run, of each session and of both merged; number of places where they meet.

    Raises:
        UserError: the sessions do not meet.
    """
    torch.set_num_threads(1)
    _, truth = source_with_truth(spec, options)
    count = len(truth.T_world_cam)
    frames = round(_SHARE * count)
    whole = _session(config, spec, options)
    parts = []
    for name, start in (("first", 0), ("second", count - frames)):
        of_part = replace(options, start=options.start + start * options.stride, frames=frames)
        parts.append(_session(config, spec, of_part, folder / name))
    found = merge_maps(MemoryAllocator(), folder / "first", folder / "second", options.seed)
    now = np.split(found.store.poses(), [found.seam])
    merged = joined(*map(carried, parts, found.parts, now))
    stamps_ns, rows = np.unique(merged.stamps_ns, return_index=True)  # some frames are in both
    merged = Trajectory(stamps_ns, merged.T_world_cam[rows])
    return {
        "whole_m": ate(whole, truth.trajectory).rmse_m,
        "merged_m": ate(merged, truth.trajectory).rmse_m,
        "parts_m": [ate(part, truth.trajectory).rmse_m for part in parts],
        "frames": count,
        "scored": len(merged),
        "places": found.places,
        "meetings": len(found.meetings),
        "keyframes": [len(part) for part in found.parts],
    }


def _session(
    config: SlamConfig, spec: str, options: SourceOptions, path: Path | None = None
) -> Trajectory:
    """The trajectory of a run over these frames; saves its map at `path`, if given."""
    source, _ = source_with_truth(spec, options)
    slam = Slam(config, options.seed)
    published(slam, source.frames())
    if path is not None:
        slam.save(path)
    return slam.trajectory()


if __name__ == "__main__":
    main()
