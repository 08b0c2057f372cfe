"""What the supervisor knows of a run: when it ends, and when processes were restarted."""

import dataclasses
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from hsslam_proto.run_messages import Health
from hsslam_services.bus.bus import Bus
from hsslam_services.health.run_state import RunState
from hsslam_services.health.status import frames_dropped, process_section, run_status
from hsslam_services.health.status_line import status_text
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import PROCESSES
from tests.services.wire_samples import pose


def test_the_seconds_of_a_run_do_not_follow_the_wall_clock(run_info):
    run = dataclasses.replace(run_info, started_ns=time.time_ns() + 10**15)  # it was set back since
    state = RunState(started_s=100.0)
    assert process_section(run, {}, state, "interrupted", 190.5)["seconds"] == 90.5


@pytest.mark.parametrize(("age_s", "tracking", "quality"), [(0, "tracked", 0.9), (60, "none", 0)])
def test_status_tells_no_old_pose_as_the_present_one(run_info, age_s, tracking, quality):
    state = RunState()
    state.posed(msgspec.structs.replace(pose(1), quality=0.9), time.monotonic() - age_s)
    with Bus(run_info.endpoint, "robot", "supervisor") as bus:
        told = run_status(run_info, state, {}, bus.requests(), "running", 0)
    assert (told.tracking, told.quality) == (tracking, quality)


@pytest.mark.parametrize(
    ("fields", "has_worked"),
    [
        ({"status": "tracked"}, True),
        ({"status": "lost", "fragment": 1}, True),
        ({"status": "lost"}, False),
    ],
)
def test_a_run_has_worked_if_it_has_tracked_frames(fields, has_worked):
    state = RunState()
    for index in (1, 2):
        assert not state.has_worked
        state.posed(msgspec.structs.replace(pose(index), **fields), 100.0 + index)
    assert state.has_worked == has_worked


@pytest.fixture
def children(tmp_path: Path) -> Iterator[dict[str, Child]]:
    """Tracker and camera, which run and do nothing."""
    made = {
        spec.name: Child(
            dataclasses.replace(spec, first_delay_s=0.0),
            tmp_path,
            lambda *_: subprocess.Popen(["sleep", "60"]),
        )
        for spec in PROCESSES
        if spec.name in ("tracker", "camera")
    }
    for child in made.values():
        child.wanted = True
        child.tick()
    yield made
    for child in made.values():
        child.kill()


def _beat(child: Child, **counters: int) -> None:
    assert child.pid is not None
    child.heard(
        Health(
            process=child.spec.name,
            pid=child.pid,
            state="running",
            rss_bytes=1,
            counters=counters,
        )
    )


def test_frames_sent_and_dropped_do_not_fall_when_tracker_and_camera_are_restarted(children):
    _beat(children["tracker"], frames_dropped=4)
    _beat(children["camera"], sent=11, skipped=3)
    for restarts in (1, 2):  # the second time before they tell anything
        for child in children.values():
            os.kill(child.pid, signal.SIGKILL)
            while child.restarts < restarts or not child.is_alive:
                child.tick()
                assert frames_dropped(children) == 7
                time.sleep(0.01)
    _beat(children["tracker"], frames_dropped=6)
    _beat(children["camera"])
    assert frames_dropped(children) == 9
    assert "frame -/11" in status_text(RunState(), children).plain
