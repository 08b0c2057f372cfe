"""The speed command's figures come from a run that tracks."""

import pytest

from hsslam_node.device.device import CPU
from hsslam_node.speed import measure
from tests.small_room import SMALL, room_frames


def test_figures_of_a_small_run():
    speed = measure("realtime", SMALL, CPU, list(room_frames()[:12]))
    assert (speed.frames, speed.lost) == (12, 0)
    assert speed.iterations_per_s * speed.iteration_ms == pytest.approx(1e3)
    assert speed.frames_per_s > 0
