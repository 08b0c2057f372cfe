"""What a node of ROS hears of the grid when the map is given up."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace

import pytest

from hsslam_node.sources.options.topics import Ros2Options
from hsslam_proto import topics
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.ros2_out import _run
from hsslam_services.run.run_info import RunInfo
from tests.services.ros2.ros_listener import RosListener
from tests.services.wire_samples import grid


@pytest.mark.parametrize("is_given_up", [True, False])
def test_only_before_a_reset_the_grid_becomes_unknown(
    make_run: Callable[..., RunInfo], endpoint: str, is_given_up: bool
):
    """The supervisor gives the map up, ends the process, and then begins the next map."""
    run = make_run(grid=True, ros2_out="/hsslam", ros2=Ros2Options(connect=endpoint))
    with (
        Worker("ros2_out", replace(run, supervisor_pid=os.getppid())) as worker,
        Bus(run.endpoint, run.robot, "distances") as bus,
        ThreadPoolExecutor(1) as thread,
        closing(RosListener(endpoint)) as listener,
    ):
        listener.hear_latched("/hsslam/map")
        bus.publisher(topics.GRID).put(grid(0))
        ended = thread.submit(_run, worker)
        try:
            listener.wait_until(lambda: listener.count("/hsslam/map") == 1)
            MapState(run.arena_dir).is_given_up = is_given_up
        finally:
            worker.stop_event().set()
        ended.result(60)
        expected = [True, False] if is_given_up else [True]
        listener.wait_until(lambda: listener.count("/hsslam/map") == len(expected))
        heard = listener.heard("/hsslam/map")
    assert [bool((m.by_rosbags.data >= 0).any()) for m in heard] == expected
