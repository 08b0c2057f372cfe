"""Smaller frames."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options import SourceOptions, SynthOptions


def _first(factor: int) -> Frame:
    synth = SynthOptions(width_px=96, height_px=72)
    source = open_source("synth:room", SourceOptions(frames=1, synth=synth, downscale=factor))
    (frame,) = source.frames()
    assert isinstance(frame, Frame)
    assert frame.camera == source.camera
    return frame


@pytest.mark.parametrize("factor", [2, 3])
def test_colour_is_averaged_and_depth_is_picked(factor: int):
    full, small = _first(1), _first(factor)
    assert (small.camera.width_px, small.camera.height_px) == (96 // factor, 72 // factor)
    blocks = full.color.reshape(72 // factor, factor, 96 // factor, factor, 3)
    assert np.abs(small.color - blocks.mean(axis=(1, 3))).max() <= 0.5 + 1e-6
    depths = full.depth_raw.reshape(72 // factor, factor, 96 // factor, factor)
    assert (depths == small.depth_raw[:, None, :, None]).any(axis=(1, 3)).all()


def test_a_pixel_sees_the_same_direction():
    full, half = _first(1).camera, _first(2).camera
    middle = np.linalg.inv(full.K) @ [20.5, 10.5, 1]  # between four pixels: the middle of one
    assert np.allclose(half.K @ middle, [10, 5, 1])


def test_a_factor_that_does_not_divide_is_refused():
    with pytest.raises(UserError, match="--downscale 7: images are 640x480"):
        open_source("synth:room", SourceOptions(downscale=7))
