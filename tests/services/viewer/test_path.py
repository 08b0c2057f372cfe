import re
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
import rerun as rr
import rerun_cli
from hypothesis import given
from hypothesis import strategies as st

from hsslam_services.viewer.path import RerunPath, colored_strips, quality_color
from tests.services.wire_samples import pose

_RED, _BLUE = (255, 0, 0), (0, 0, 255)


def test_colour_says_how_well_the_camera_is_tracked():
    assert quality_color(0.0) == quality_color(0.3) == (255, 110, 40)
    assert quality_color(0.9) == quality_color(1.0) == (70, 200, 255)
    assert quality_color(0.45) == (255, 165, 50)


@pytest.mark.parametrize("quality", [0.0, 0.31, 0.6, 0.75, 1.0])
def test_colours_are_bytes(quality):
    assert all(0 <= value <= 255 for value in quality_color(quality))


@given(st.lists(st.sampled_from([_RED, _BLUE]), min_size=2, max_size=12))
def test_poses_of_one_colour_are_one_strip(colors):
    points = [(float(k), 0.0, 0.0) for k in range(len(colors))]
    strips, strip_colors = colored_strips(points, colors)
    drawn = [
        (segment, color)
        for strip, color in zip(strips, strip_colors, strict=True)
        for segment in pairwise(strip)
    ]
    assert drawn == list(zip(pairwise(points), colors[1:], strict=True))
    assert all(a != b for a, b in pairwise(strip_colors))


def test_a_long_path_is_few_entities(tmp_path):
    stream = rr.RecordingStream("hsslam", recording_id="path")
    stream.set_sinks(rr.FileSink(tmp_path / "path.rrd"))
    path = RerunPath(stream)
    for index in range(64 * 100):
        path.add(pose(index))
    path.draw()
    stream.flush()
    stream.disconnect()
    command = [str(Path(rerun_cli.__file__).parent / "rerun"), "rrd", "print", "-v"]
    printed = subprocess.run(
        [*command, tmp_path / "path.rrd"], check=True, capture_output=True, text=True
    ).stdout
    old = set(re.findall("world/trajectory/old/[0-9]+", printed))
    assert 1 <= len(old) <= 2
    assert "Clear" in printed
