"""Opens a source with a true pose for every frame, and collects the library's poses for its frames."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import GroundTruth, open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame, Source

_QUICK_ITERATIONS = 3


@dataclass(frozen=True)
class Published:
    """The poses that the library published for n frames."""

    tracked: np.ndarray  # [n] bool, False: lost
    T_world_cam: np.ndarray  # [n, 4, 4] as published, before later corrections
    took_s: np.ndarray  # [n] tracking and mapping


def source_with_truth(spec: str, options: SourceOptions) -> tuple[Source, GroundTruth]:
    """Open a source and its ground truth.

    Raises:
        UserError: a frame has no true pose.
    """
    source, truth = open_source(spec, options), open_ground_truth(spec, options)
    if truth is None or len(truth.T_world_cam) != source.frame_count:
        raise UserError(f"source {spec}: expected a true pose for every frame")
    return source, truth


def published(slam: Slam, frames: Iterable[Frame | BadFrame]) -> Published:
    """Track and map the frames in turn.

    Raises:
        UserError: a frame is not readable.
    """
    results, took_s = [], []
    for frame in frames:
        if not isinstance(frame, Frame):
            raise UserError(f"frame {frame.index}: {frame.reason}")
        start = time.perf_counter()
        results.append(slam.process(frame))
        took_s.append(time.perf_counter() - start)
    tracked = np.array([result.status != "lost" for result in results])
    T_world_cam = np.stack([result.T_world_cam for result in results])
    return Published(tracked, T_world_cam, np.array(took_s))


def with_poor_first_map(config: SlamConfig) -> SlamConfig:
    """The configuration with few first iterations, for `--quick`, which only tests a script."""
    return replace(config, mapper=replace(config.mapper, first_iterations=_QUICK_ITERATIONS))
