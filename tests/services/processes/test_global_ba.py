"""The loop of the global BA process, over an arena that a real pipeline has filled."""

import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.slam import Slam
from hsslam_proto import topics
from hsslam_proto.messages import MapVersion
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes import global_ba
from hsslam_services.run.run_info import RunInfo
from tests.small_room import SMALL, displaced, pose_error, room_frames, room_poses

_ENDLESS = 10**6  # iterations of one round


def test_a_round_at_work_ends_when_the_map_may_not_change_any_more(
    make_run: Callable[..., RunInfo],
):
    ba = replace(SMALL.ba, method="joint", iterations=_ENDLESS, every_keyframes=1)
    config = replace(
        SMALL,
        mapper=replace(SMALL.mapper, first_iterations=10, iterations=2),
        ba=replace(ba, selection="uniform", pose_rate=1e-3, rays=128),
    )
    run = make_run(slam=config)
    slam = Slam(replace(config, ba=replace(ba, enabled=False)), arrays=Arena(Path(run.arena_dir)))
    for frame in room_frames()[:9]:
        slam.process(frame)
    store, parameters = slam.store, slam.parameters
    assert store and parameters and store.count > 1
    mode, before = MapState(run.arena_dir), (parameters.step, store.poses())
    with Bus(run.endpoint, run.robot, "test") as bus, Worker("global_ba", run) as worker:
        corrections = bus.subscribe(topics.CORRECTION, 4)
        maps = bus.publisher(topics.MAP)
        loop = threading.Thread(target=global_ba._run, args=(worker,), daemon=True)
        loop.start()
        maps.put(MapVersion(version=1, iterations=1, loss=0.0, keyframes=3, mapping_ms=0.0))
        _wait_for(lambda: parameters.step > before[0] + 3)
        mode.localise_only = True
        _wait_for(lambda: worker.counters.get("rounds", 0) == 1)
        step = parameters.step
        worker.stop_event().set()
        loop.join()
        assert corrections.wait(0.3) is None
    assert parameters.step == step < before[0] + _ENDLESS
    np.testing.assert_array_equal(store.poses(), before[1])
    assert store.pose_version == 0


@pytest.mark.parametrize(("stopped_s_ago", "is_done"), [(0.0, True), (60.0, False)])
def test_it_ends_with_the_keyframes_that_no_round_has_looked_at_while_there_is_time(
    make_run: Callable[..., RunInfo], stopped_s_ago: float, is_done: bool
):
    ba = replace(SMALL.ba, method="graph", every_keyframes=1000, iterations=1)
    mapper = replace(SMALL.mapper, first_iterations=10, iterations=2)
    graph = replace(SMALL.pose_graph, aligned_every=1)
    config = replace(SMALL, mapper=mapper, ba=ba, pose_graph=graph)
    run = make_run(slam=config)
    slam = Slam(replace(config, ba=replace(ba, enabled=False)), arrays=Arena(Path(run.arena_dir)))
    for frame in room_frames()[:25]:
        slam.process(frame)
    store = slam.store
    assert store and store.count > 5
    right = store.pose(3)
    store.correct_poses(np.array([3]), displaced(right, 0.02, 1.0, seed=3)[None])
    MapState(run.arena_dir).stopped_ns = time.monotonic_ns() - int(1e9 * stopped_s_ago)
    with Worker("global_ba", replace(run, supervisor_pid=os.getppid())) as worker:
        worker.stop_event().set()
        global_ba._run(worker)
    error_m = np.linalg.norm(store.pose(3)[:3, 3] - right[:3, 3])
    assert (error_m < 0.005) == is_done and (error_m > 0.015) != is_done


@pytest.mark.parametrize("fragment", [0, 1])
def test_in_lockstep_it_ends_with_a_round_if_a_fragment_has_joined_the_map(
    make_run: Callable[..., RunInfo], fragment: int
):
    ba = replace(SMALL.ba, method="graph", every_keyframes=1000, iterations=1)
    mapper = replace(SMALL.mapper, first_iterations=10, iterations=2)
    graph = replace(SMALL.pose_graph, aligned_every=1, loop_gap=3)
    config = replace(SMALL, mapper=mapper, ba=ba, pose_graph=graph)
    run = make_run(slam=config, pace="lockstep")
    slam = Slam(replace(config, ba=replace(ba, enabled=False)), arrays=Arena(Path(run.arena_dir)))
    for frame in room_frames()[:13]:
        slam.process(frame)
    store, right = slam.store, room_poses()[5]
    assert store
    gap = np.diag(np.repeat([0.1**2, 0.05**2], 3))
    wrong = displaced(right, 0.02, 1.0)
    k = store.append(room_frames()[5], wrong, gap_covariance=gap, fragment=fragment)
    then = store.pose(1)
    with Worker("global_ba", replace(run, supervisor_pid=os.getppid())) as worker:
        worker.stop_event().set()
        _BesideMapping(worker).catch_up()
    assert store.pose_version == 2 * fragment  # mapping has refined a pose, and then came the round
    assert (pose_error(store.pose(k), right)[0] < 0.005) == bool(fragment)
    moved_m = np.linalg.norm(store.pose(1)[:3, 3] - then[:3, 3])
    assert (moved_m > 0.08) == bool(fragment)  # the round has not taken that back


class _BesideMapping(global_ba._BaLoop):
    """While it rests the first time, keyframe 1 is refined by 10 cm."""

    def _rest(self) -> None:
        store = self._link.store()
        if store and store.pose_version == 0:
            store.correct_poses(np.array([1]), displaced(store.pose(1), 0.1, 0.0)[None])
        super()._rest()


def _wait_for(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
