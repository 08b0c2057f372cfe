"""Frames without depth where a mask is black."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options import SourceOptions, SynthOptions

SYNTH = SynthOptions(width_px=96, height_px=72)


def _first(**options) -> Frame:
    (frame,) = open_source("synth:room", SourceOptions(frames=1, synth=SYNTH, **options)).frames()
    assert isinstance(frame, Frame)
    return frame


def _mask(path: Path, width_px: int = 96, channels: int = 1) -> str:
    """Black in the lower third."""
    image = np.full((72, width_px, channels), 255, np.uint8)
    image[48:] = 0
    cv2.imwrite(str(path), image)
    return str(path)


@pytest.mark.parametrize("noise", ["none", "kinect"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_black_pixels_have_no_depth_and_the_others_keep_theirs(tmp_path, noise, channels):
    plain = _first(noise=noise)
    masked = _first(noise=noise, mask=_mask(tmp_path / "mask.png", channels=channels))
    assert plain.depth_raw[48:].any() and not masked.depth_raw[48:].any()
    assert np.array_equal(plain.depth_raw[:48], masked.depth_raw[:48])
    assert np.array_equal(plain.color, masked.color)


def test_a_coloured_pixel_is_not_black(tmp_path):
    image = np.zeros((72, 96, 3), np.uint8)
    image[:, :, 0] = 1
    cv2.imwrite(str(tmp_path / "mask.png"), image)
    assert np.array_equal(_first(mask=str(tmp_path / "mask.png")).depth_raw, _first().depth_raw)


def test_a_mask_has_the_size_of_the_frames_before_they_are_made_smaller(tmp_path):
    small = _first(mask=_mask(tmp_path / "mask.png"), downscale=2)
    assert small.depth_raw[:24].any() and not small.depth_raw[24:].any()


def test_a_mask_that_does_not_fit_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"--mask .*wide.png: 100x72 pixels: expected 96x72"):
        _first(mask=_mask(tmp_path / "wide.png", width_px=100))
    (tmp_path / "mask.txt").write_text("no image")
    for name, why in (("mask.txt", "not an image"), ("gone.png", "No such file")):
        with pytest.raises(UserError, match=f"--mask .*{name}: {why}"):
            _first(mask=str(tmp_path / name))
