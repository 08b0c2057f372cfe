"""When a map can be thrown away."""

import contextlib
import errno
import os
import subprocess
import threading
from collections.abc import Iterator

import pytest

from hsslam_node.presets import PRESETS
from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import RESET
from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.bus.ask import NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.spawn import Spawn
from hsslam_services.requests.gateway import Gateway
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary


def _cannot_start(*_):
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))


@pytest.mark.parametrize(
    ("options", "keyframe", "answer"),
    [
        ({}, -1, "reset: there is no map yet: expected a first keyframe"),
        ({}, 0, "reset: trajectory_saver .*; the map stays"),  # it was begun
        (
            {"map": "kitchen", "slam": PRESETS["realtime"]},
            0,
            "reset: the map of --map is being loaded",
        ),
    ],
)
def test_a_map_can_be_thrown_away_from_its_first_keyframe_on(make_run, options, keyframe, answer):
    run_info = make_run(**options)
    lost = {FRAGMENTS_NOT_SAVED: {"1": "the disk is full"}}
    write_result(run_info.path, "tracker", ProcessResult(summary=lost))
    with _gateway(run_info, _cannot_start, keyframe), pytest.raises(RefusedError, match=answer):
        _ask(run_info)
    # the next tracker has a result of its own
    assert read_summary(run_info.path) == (lost if answer.startswith("reset: traj") else {})


def test_the_error_of_the_trajectory_saver_is_told_though_the_summary_cannot_be_written(run_info):
    (run_info.path / "summary.json").mkdir()
    failed = ProcessResult(error="trajectory.txt: the disk is full")

    def spawn(*_: object) -> subprocess.Popen:
        write_result(run_info.path, "trajectory_saver", failed)
        return subprocess.Popen(["false"])

    answer = "reset: trajectory.txt: the disk is full; the map stays"
    with _gateway(run_info, spawn, keyframe=0), pytest.raises(RefusedError, match=answer):
        _ask(run_info)


@contextlib.contextmanager
def _gateway(run_info: RunInfo, spawn: Spawn, keyframe: int) -> Iterator[None]:
    """A gateway without processes, whose loop runs in a thread."""
    is_over = threading.Event()
    with Bus(run_info.endpoint, run_info.robot, "supervisor") as bus:
        gateway = Gateway(bus, run_info, spawn)

        def turn() -> None:
            while not is_over.wait(0.005):
                gateway.tick(RunState(last_keyframe=keyframe), {}, 0)

        loop = threading.Thread(target=turn)
        loop.start()
        try:
            yield
        finally:
            is_over.set()
            loop.join()
            gateway.close()


def _ask(run_info):
    while True:
        try:
            return ask(run_info.endpoint, run_info.robot, RESET, Ask())
        except NoServiceError:  # the router knows the gateway a moment later
            continue
