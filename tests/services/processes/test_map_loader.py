"""The map loader refuses a source of another camera than that of the map."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import PRESETS
from hsslam_node.sources.open_source import open_source
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.map_loader import _expect_camera, _run
from hsslam_services.run.run_info import RunInfo
from tests.small_room import SMALL
from tests.two_sessions import FIRST, session


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


def test_a_live_camera_is_left_to_the_camera_process(
    make_run: Callable[..., RunInfo], tmp_path: Path
):
    """Only one process can have it."""
    store, parameters = session(FIRST)
    path = tmp_path / "map.safetensors"
    save_checkpoint(path, map_snapshot(store, parameters, SMALL))
    run = make_run(source="ros2:/camera", map=str(path), slam=SMALL)  # no camera, no router
    with Worker("map_loader", replace(run, supervisor_pid=os.getppid())) as worker:
        _run(worker)
