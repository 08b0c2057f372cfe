"""A source with a true pose for every frame, and what the library publishes of some of its frames."""

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
    """What was published for each of n frames."""

    tracked: np.ndarray  # [n] bool, not lost
    T_world_cam: np.ndarray  # [n, 4, 4] as known at the time
    took_s: np.ndarray  # [n] tracking and mapping


def source_with_truth(spec: str, options: SourceOptions) -> tuple[Source, GroundTruth]:
    """The source, and the truth about it.

    Raises:
        UserError: not every frame has a true pose.
    """
    source, truth = open_source(spec, options), open_ground_truth(spec, options)
    if truth is None or len(truth.T_world_cam) != source.frame_count:
        raise UserError(f"source {spec}: expected a true pose for every frame")
    return source, truth


def published(slam: Slam, frames: Iterable[Frame | BadFrame]) -> Published:
    """Give the frames to the library, one after the other.

    Raises:
        UserError: one of them could not be read.
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
    """For `--quick`: to see whether a script works, not how well."""
    return replace(config, mapper=replace(config.mapper, first_iterations=_QUICK_ITERATIONS))
