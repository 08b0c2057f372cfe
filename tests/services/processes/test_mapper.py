"""The mapper process between frames and when a run ends, over an arena that a real pipeline has filled."""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.slam import Slam
from hsslam_proto import topics
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.map_state import MapState
from hsslam_services.launch.worker import Worker
from hsslam_services.processes import mapper
from hsslam_services.run.run_info import RunInfo
from tests.services.wire_samples import pose
from tests.small_room import SMALL, room_frames, room_poses


def _begun(
    make_run: Callable[..., RunInfo], pace: str = "lockstep", **parts: Any
) -> tuple[RunInfo, KeyframeStore, FieldParameters]:
    """A run without bundle adjustment whose arena has the first frame as keyframe, and its map."""
    config = replace(SMALL, ba=replace(SMALL.ba, enabled=False), **parts)
    run = make_run(slam=config, pace=pace)
    slam = Slam(config, arrays=Arena(Path(run.arena_dir)))
    slam.process(room_frames()[0])
    assert slam.store and slam.parameters
    return run, slam.store, slam.parameters


def test_the_map_grows_to_a_fragment_that_joins_after_the_last_frame(
    make_run: Callable[..., RunInfo],
):
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2, last_iterations=1)
    run, store, parameters = _begun(make_run, mapper=quick)
    away = np.eye(4)
    away[0, 3] = 9.0  # beyond `most_m`
    assert not parameters.layout.bound.contains(away[None, :3, 3])[0]
    with Worker("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = mapper._MapperLoop(worker)
        store.mark_inherited()
        assert not mapper._MapperLoop(worker).has_work()  # a saved map stays until a keyframe comes
        store.append(room_frames()[1], away, fragment=1)
        loop.do_last_iterations()
    step = parameters.step
    assert parameters.follow() and parameters.layout.bound.contains(away[None, :3, 3])[0]
    assert (
        step == 2 + 2 * 2 + 2
    )  # first ones, of both keyframes as a mapper that resumes, last ones


@pytest.mark.parametrize(
    ("left_s", "save_s", "is_begun"), [(0.5, 0.1, True), (-60.0, 0.1, False), (0.5, 5.0, False)]
)
def test_last_iterations_end_in_time_for_the_map_to_be_saved(
    make_run: Callable[..., RunInfo], left_s: float, save_s: float, is_begun: bool
):
    """`left_s`: until a save that takes 0.1 s must begin; the first save took `save_s`."""
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2, last_iterations=10_000)
    run, _, parameters = _begun(make_run, pace="realtime", mapper=quick)
    mode = MapState(run.arena_dir)
    budget_s = run.options.finish_budget_s
    mode.stopped_ns = time.monotonic_ns() - int(1e9 * (budget_s - 1.2 - left_s))
    mode.saved_in_ns = int(1e9 * save_s)
    with Worker("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = mapper._MapperLoop(worker)
        before, begin_s = parameters.step, time.monotonic()
        loop.do_last_iterations()
        done, took_s = parameters.step - before, time.monotonic() - begin_s
    assert (done > 0) == is_begun and took_s < 0.5 * budget_s


class _Ended(Worker):
    """The source ends when the process is ready; the map must be on disk in `left_s` and 1 s for a save."""

    left_s: float

    def ready(self) -> None:
        super().ready()
        since_s = self.options.finish_budget_s - 1.0 - self.left_s
        MapState(self.run.arena_dir).stopped_ns = time.monotonic_ns() - int(1e9 * since_s)
        self.stop_event().set()


def _continued(make_run: Callable[..., RunInfo], left_s: float) -> KeyframeStore:
    """The keyframes of a run in real time that has shown a view of a saved map eight times more, and has
    ended. Its last iterations take longer than it may."""
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2, last_iterations=10_000)
    run, store, _ = _begun(make_run, pace="realtime", mapper=quick)
    store.mark_inherited()
    for _ in range(8):
        store.append(room_frames()[0], room_poses()[0])
    with _Ended("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        worker.left_s = left_s
        mapper._run(worker)
    return store


def test_known_keyframes_retire_before_the_last_iterations_which_use_up_the_time(
    make_run: Callable[..., RunInfo], capfd: pytest.CaptureFixture[str]
):
    store = _continued(make_run, left_s=0.7)
    assert store.kept().tolist() == [0, 8]
    told = capfd.readouterr().err
    assert "last iterations done: --finish-s allows no more" in told
    assert "not compared" not in told


def test_keyframes_that_no_time_is_left_to_compare_stay_and_are_told(
    make_run: Callable[..., RunInfo], capfd: pytest.CaptureFixture[str]
):
    store = _continued(make_run, left_s=-1.0)
    assert store.kept().tolist() == list(range(9))
    told = "info: 7 keyframes were not compared with the loaded map: --finish-s allows no more"
    assert told in capfd.readouterr().err


class _StoppedAtFirst(mapper._MapperLoop):
    """The supervisor ends the process while it does the first of the waiting iterations."""

    def work(self) -> None:
        super().work()
        self._worker.stop_event().set()


def test_in_lockstep_the_mapper_leaves_waiting_keyframes_to_the_end_if_it_must_stop(
    make_run: Callable[..., RunInfo],
):
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2)
    run, store, parameters = _begun(make_run, mapper=quick)
    with Worker("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = _StoppedAtFirst(worker)
        for k in range(1, 9):  # as of a fragment that joins
            store.append(room_frames()[k], room_poses()[k])
        before = parameters.step
        worker.bus.publisher(topics.POSE).put(pose(8))
        mapper._follow_keyframes(worker, loop)
        assert parameters.step == before + 2
        assert loop.has_work()


@pytest.mark.parametrize(("fragment", "waiting"), [(0, 6), (1, 9 + 6)])
def test_in_real_time_keyframes_of_a_join_all_get_their_iterations(
    make_run: Callable[..., RunInfo], fragment: int, waiting: int
):
    """Nine keyframes come at once, with the fragment's number or as of a mapper that is late; then seven."""
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2)
    run, store, parameters = _begun(make_run, pace="realtime", mapper=quick)
    with Worker("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = mapper._MapperLoop(worker)
        while loop.has_work():
            loop.work()
        before = parameters.step
        for k in range(1, 10):
            store.append(room_frames()[k], room_poses()[k], fragment=fragment)
        assert loop.has_work()
        for k in range(10, 17):
            store.append(room_frames()[k], room_poses()[k], fragment=fragment)
        while loop.has_work():
            loop.work()
        assert parameters.step == before + 2 * waiting


def test_the_mapper_makes_room_for_a_fragment_that_waits(make_run: Callable[..., RunInfo]):
    quick = replace(SMALL.mapper, first_iterations=2, iterations=2)
    few = replace(SMALL.keyframes, capacity=12)
    run, store, _ = _begun(make_run, mapper=quick, keyframes=few)
    for k in range(1, 9):
        store.append(room_frames()[k], room_poses()[k])
    with Worker("mapper", replace(run, supervisor_pid=os.getppid())) as worker:
        loop = mapper._MapperLoop(worker)
        loop.make_room()
        assert store.room.free == 3
        store.room.want(4)
        loop._mode.localise_only = True  # the keyframes of the map stay
        loop.make_room()
        assert store.room.free == 3
        loop._mode.localise_only = False
        loop.make_room()
    assert store.room.free == 4
