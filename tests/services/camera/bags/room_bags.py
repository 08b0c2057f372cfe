"""The built-in room for bags, and bags opened as a source; alone because two test modules use it."""

from pathlib import Path

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import Source
from hsslam_services.camera.open_source import open_any_source

ROOM = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), frames=6)


def whole_frames(source: Source, first: int = 0) -> list[Frame]:
    frames = list(source.frames(first))
    assert all(isinstance(frame, Frame) for frame in frames)
    return [frame for frame in frames if isinstance(frame, Frame)]


def opened(path: Path, units_per_m: float | None = None, **options) -> Source:
    camera = CameraOptions(depth_scale=units_per_m)
    return open_any_source(f"bag:{path}", SourceOptions(camera=camera, **options))


def expect_same(found: list[Frame], expected: list[Frame]) -> None:
    """Assert that two lists hold the same frames."""
    assert [frame.stamp_ns for frame in found] == [frame.stamp_ns for frame in expected]
    for frame, other in zip(found, expected, strict=True):
        assert (frame.index, frame.camera) == (other.index, other.camera)
        assert frame.depth_units_per_m == other.depth_units_per_m
        np.testing.assert_array_equal(frame.color, other.color)
        np.testing.assert_array_equal(frame.depth_raw, other.depth_raw)
