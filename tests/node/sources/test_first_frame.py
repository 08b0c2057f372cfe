"""A source that begins late gives the frames that it would have given, and decodes none before them."""

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.reordered import Reordered
from hsslam_node.sources.source import Source

_ROOM = SourceOptions(synth=SynthOptions(width_px=64, height_px=48), frames=8)


def _expect_same(source: Source, first: int) -> None:
    whole, late = list(source.frames()), list(source.frames(first))
    assert [item.index for item in late] == [item.index for item in whole[first:]]
    for expected, found in zip(whole[first:], late, strict=True):
        assert isinstance(expected, Frame)
        assert isinstance(found, Frame)
        assert found.stamp_ns == expected.stamp_ns
        np.testing.assert_array_equal(found.color, expected.color)
        np.testing.assert_array_equal(found.depth_raw, expected.depth_raw)


@pytest.mark.parametrize("first", [0, 5, 8, 20])
def test_of_rendered_scenes_with_effects(first):
    options = replace(_ROOM, noise="kinect", exposure="drift", downscale=2)
    _expect_same(open_source("synth:room", options), first)


def test_of_reordered_frames():
    _expect_same(Reordered(open_source("synth:room", _ROOM), (0, 1, 2, 2, 1, 5, 7)), 4)


def test_of_a_long_recording_at_once(tmp_path: Path):
    count = 30_000
    for kind in ("rgb", "depth"):
        (tmp_path / kind).mkdir()
        lines = (f"{k / 30:.6f} {kind}/0.png\n" for k in range(count))
        (tmp_path / f"{kind}.txt").write_text("".join(lines))
    cv2.imwrite(str(tmp_path / "rgb" / "0.png"), np.full((48, 64, 3), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "depth" / "0.png"), np.full((48, 64), 5000, np.uint16))
    (tmp_path / "camera.json").write_text(
        '{"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 31.5, "cy": 23.5, "depth_scale": 5000}'
    )
    source = open_source(f"tum:{tmp_path}")
    begin_s = time.process_time()
    frame = next(iter(source.frames(count - 1)))
    assert time.process_time() - begin_s < 1.0  # all of them take eight
    assert frame.index == count - 1
