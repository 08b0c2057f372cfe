"""Frames with sensor noise, each with its true pose and its true depth; for the benchmark alone."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.effects.kinect_noise import KinectNoise
from hsslam_node.sources.options.source import SourceOptions


@dataclass(frozen=True)
class TrueFrame:
    """The frame of the sensor, and the truth. The world is the camera of the first frame."""

    frame: Frame
    T_world_cam: np.ndarray  # [4, 4]
    depth_m: np.ndarray  # [H, W] float32, without noise; 0: no depth


def true_frames(spec: str, options: SourceOptions) -> Iterator[TrueFrame]:
    """The frames of a source with exact depth, with the noise of the options added.

    Raises:
        UserError: a frame is not readable, or has no true pose.
    """
    source, truth = source_with_truth(spec, replace(options, noise="none"))
    noise = KinectNoise(source, options.seed) if options.noise == "kinect" else None
    T_first_world = inverse(truth.T_world_cam[0])
    for frame, T in zip(source.frames(), truth.T_world_cam, strict=True):
        if not isinstance(frame, Frame):
            raise UserError(f"frame {frame.index}: {frame.reason}")
        sensed = noise.changed(frame) if noise else frame
        yield TrueFrame(sensed, T_first_world @ T, frame.depth_m())
