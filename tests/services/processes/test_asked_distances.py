"""Who asks for all blocks of distances, without subscribing, gets those of now; the series of a restart."""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import pytest

from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.distances import _PublishedBlocks
from tests.services.wire_samples import pose
from tests.until import until

_SPACE = VoxelGrid(0.05, (0, 0, 0), (16, 16, 16))


def test_blocks_of_the_next_update_answer_who_asks(run_info):
    run, pause = replace(run_info, supervisor_pid=os.getppid()), threading.Event()
    with (
        Worker("distances", run) as worker,
        Bus(run.endpoint, run.robot, "test") as bus,
        ThreadPoolExecutor(1) as thread,
    ):
        blocks, occupancy = _PublishedBlocks(worker), Occupancy(_SPACE)

        def answered(first: int) -> int:
            """Index of the frame of the answer, while there are updates of frames from `first` on."""
            for tried in range(100):
                asked = thread.submit(lambda: list(bus.state(topics.ESDF_BLOCKS)))
                for index in range(first + 1000 * tried, first + 1000 * (tried + 1)):
                    if asked.done():
                        break
                    blocks.follow(occupancy, pose(index))
                    pause.wait(0.005)
                if messages := asked.result():  # else the queryable is not known yet
                    return messages[0].index
            raise AssertionError("no answer")

        assert answered(first=0) >= 0
        pause.wait(1.05)
        assert answered(first=10**6) >= 10**6


def test_a_restart_after_the_clock_was_set_back_begins_a_later_series(
    run_info, monkeypatch: pytest.MonkeyPatch
):
    """Subscribers ignore the blocks of an earlier series."""
    run = replace(run_info, supervisor_pid=os.getppid())
    series: list[int] = []
    with Bus(run.endpoint, run.robot, "test") as bus:
        heard = bus.subscribe(topics.ESDF_BLOCKS, 64)

        def is_heard(blocks: _PublishedBlocks, index: int) -> bool:
            blocks.follow(Occupancy(_SPACE), pose(index))
            series.extend([one.series for one in heard.drain() if one.index == index][:1])
            return len(series) > index

        for index, clock_ns in enumerate((2 * 10**18, 10**18)):
            monkeypatch.setattr(time, "time_ns", partial(int, clock_ns))
            with Worker("distances", run) as worker:
                until(partial(is_heard, _PublishedBlocks(worker), index), 60)
    assert series[0] < series[1]
