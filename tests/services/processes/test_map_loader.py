"""The map loader refuses a source of another camera than that of the map."""

from collections.abc import Callable

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import PRESETS
from hsslam_node.sources.open_source import open_source
from hsslam_services.processes.map_loader import _expect_camera
from hsslam_services.run.run_info import RunInfo


def test_a_depth_scale_may_come_from_a_driver_that_tells_it_with_seven_digits(
    make_run: Callable[..., RunInfo],
):
    run = make_run(map="saved", slam=PRESETS["realtime"])
    camera = open_source("synth:room").camera

    def of_scale(units_per_m: float) -> KeyframeStore:
        return KeyframeStore.create(MemoryAllocator(), camera, units_per_m, 2)

    told = 1.0 / float(np.float32(1 / 5000))
    assert told != 5000.0
    _expect_camera(run, of_scale(told))
    words = "--map saved: source synth:room has 5000 depth units per metre: expected 5000.1, as in"
    with pytest.raises(UserError, match=words):
        _expect_camera(run, of_scale(5000.1))
