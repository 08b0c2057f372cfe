"""When a map can be thrown away."""

import errno
import os
import threading

import pytest

from hsslam_node.presets import PRESETS
from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import RESET
from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.bus.ask import NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.health.run_state import RunState
from hsslam_services.requests.gateway import Gateway
from hsslam_services.run.process_result import ProcessResult, write_result
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
    is_over, run_info = threading.Event(), make_run(**options)
    lost = {FRAGMENTS_NOT_SAVED: {"1": "the disk is full"}}
    write_result(run_info.path, "tracker", ProcessResult(summary=lost))
    with Bus(run_info.endpoint, run_info.robot, "supervisor") as bus:
        gateway = Gateway(bus, run_info, _cannot_start)

        def turn() -> None:
            while not is_over.wait(0.005):
                gateway.tick(RunState(last_keyframe=keyframe), {}, 0)

        loop = threading.Thread(target=turn)
        loop.start()
        try:
            with pytest.raises(RefusedError, match=answer):
                _ask(run_info)
        finally:
            is_over.set()
            loop.join()
            gateway.close()
    # the next tracker has a result of its own
    assert read_summary(run_info.path) == (lost if answer.startswith("reset: traj") else {})


def _ask(run_info):
    while True:
        try:
            return ask(run_info.endpoint, run_info.robot, RESET, Ask())
        except NoServiceError:  # the router knows the gateway a moment later
            continue
