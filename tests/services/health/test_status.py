"""What the supervisor knows of a run when it ends."""

import dataclasses
import time

from hsslam_services.health.run_state import RunState
from hsslam_services.health.status import process_section


def test_the_seconds_of_a_run_do_not_follow_the_wall_clock(run_info):
    run = dataclasses.replace(run_info, started_ns=time.time_ns() + 10**15)  # it was set back since
    state = RunState(started_s=100.0)
    assert process_section(run, {}, state, "interrupted", 190.5)["seconds"] == 90.5
