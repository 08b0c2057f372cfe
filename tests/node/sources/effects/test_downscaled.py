"""Smaller frames."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.effects.downscaled import Downscaled
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions


def _first(factor: int) -> Frame:
    synth = SynthOptions(width_px=96, height_px=72)
    source = open_source("synth:room", SourceOptions(frames=1, synth=synth, downscale=factor))
    (frame,) = source.frames()
    assert isinstance(frame, Frame)
    assert frame.camera == source.camera
    return frame


@pytest.mark.parametrize("factor", [2, 3])
def test_colour_is_averaged(factor: int):
    full, small = _first(1), _first(factor)
    assert (small.camera.width_px, small.camera.height_px) == (96 // factor, 72 // factor)
    blocks = full.color.reshape(72 // factor, factor, 96 // factor, factor, 3)
    assert np.abs(small.color - blocks.mean(axis=(1, 3))).max() <= 0.5 + 1e-6


def test_depth_is_picked_if_there_is_a_pixel_in_the_middle():
    np.testing.assert_array_equal(_first(3).depth_raw, _first(1).depth_raw[1::3, 1::3])


@pytest.mark.parametrize("factor", [2, 4])
def test_depth_between_pixels_is_that_of_the_plane_they_see(factor: int):
    synth = SynthOptions(width_px=960, height_px=720)
    source = open_source("synth:room", SourceOptions(frames=1, synth=synth))
    camera = source.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    ray = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    depth = 20_000 / (ray @ np.array([0.4, -0.2, 1.0]))  # [720, 960] of a slanted wall
    depth[:100] = 0
    depth[300:, 481:] *= 2  # an edge between the pixels of a block
    raw = np.rint(depth).astype(np.uint16)
    frame = Frame(0, 0, camera, np.zeros((720, 960, 3), np.uint8), raw, 5000.0)
    small = Downscaled(source, factor).changed(frame)
    middle = (factor - 1) / 2
    v, u = (np.mgrid[: 720 // factor, : 960 // factor] * factor + middle).astype(np.float64)
    ray = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    wall = 20_000 / (ray @ np.array([0.4, -0.2, 1.0]))
    sides = np.stack([np.zeros_like(wall), wall, 2 * wall])
    on_side = np.where(v < 100, 0, np.where((v >= 300) & (u > 481), 2, 1))
    is_edge = (
        (np.abs(u - 480.5) < factor) | (np.abs(v - 299.5) < factor) | (np.abs(v - 99.5) < factor)
    )
    off = np.abs(small.depth_raw - sides)  # [3, h, w]; one of four pixels is 5 off or more
    assert np.take_along_axis(off, on_side[None], 0)[0][~is_edge].max() <= 1.01
    assert off.min(axis=0).max() < 50  # at an edge there is no depth between its sides


def test_a_pixel_sees_the_same_direction():
    full, half = _first(1).camera, _first(2).camera
    middle = np.linalg.inv(full.K) @ [20.5, 10.5, 1]  # between four pixels: the middle of one
    assert np.allclose(half.K @ middle, [10, 5, 1])


def test_a_factor_that_does_not_divide_is_refused():
    with pytest.raises(UserError, match="--downscale 7: images are 640x480"):
        open_source("synth:room", SourceOptions(downscale=7))
