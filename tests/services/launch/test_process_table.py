"""How long processes may take."""

import pytest

from hsslam_node.presets import PRESETS
from hsslam_node.sources.options.topics import Ros2Options
from hsslam_proto.requests import RESET, SAVE
from hsslam_services.disk.disk_work import STEP_S
from hsslam_services.launch.process_table import (
    MAP_SAVER,
    PROCESSES,
    TRAJECTORY_SAVER,
    one_shot_timeout_s,
    processes_of,
)
from hsslam_services.run.options import ServeOptions

_AN_HOUR = 30 * 3600  # frames


def test_a_client_waits_longer_than_the_savers_for_its_request_may_take():
    """For a reset of a run of a day; old processes end and new ones start beside."""
    assert one_shot_timeout_s(MAP_SAVER, 0) + STEP_S < SAVE.takes_s
    assert one_shot_timeout_s(TRAJECTORY_SAVER, 24 * _AN_HOUR) + STEP_S < RESET.takes_s


@pytest.mark.parametrize("hours", [1, 24, 7 * 24])
def test_the_time_for_the_trajectories_grows_with_the_run(hours):
    poses = hours * _AN_HOUR
    assert one_shot_timeout_s(TRAJECTORY_SAVER, poses) >= 60 + 10 * hours
    assert one_shot_timeout_s(MAP_SAVER, poses) == one_shot_timeout_s(MAP_SAVER, 0)


def test_a_tracker_by_rendering_may_take_longer_for_a_frame():
    def stall_s(preset) -> float:
        options = ServeOptions(preset=preset, slam=PRESETS[preset])
        (tracker,) = [spec for spec in processes_of(options) if spec.name == "tracker"]
        return tracker.stall_timeout_s

    assert stall_s("realtime") == 10
    assert stall_s("paper") == stall_s("co-slam") == 150


def test_a_live_camera_may_start_for_as_long_as_it_waits_for_its_images():
    def startup_s(timeout_s: float) -> float:
        options = ServeOptions(source="ros2:/camera", ros2=Ros2Options(timeout_s=timeout_s))
        (camera,) = [spec for spec in processes_of(options) if spec.reads_source]
        return camera.startup_timeout_s

    assert startup_s(10) == 300
    assert startup_s(600) > 1200


def test_only_what_a_run_needs_may_refuse_its_input():
    refuse = {
        pace: {spec.name for spec in PROCESSES if spec.can_refuse(pace)}
        for pace in ("realtime", "lockstep")
    }
    assert refuse["realtime"] == {"camera", "tracker", "mapper"}
    assert refuse["lockstep"] == {"camera", "tracker", "mapper", "global_ba"}


def test_what_lockstep_waits_for_does_not_give_way():
    at = {spec.name: (spec.nice_at("realtime"), spec.nice_at("lockstep")) for spec in PROCESSES}
    assert at["mapper"] == (5, 0) and at["global_ba"] == (14, 0) and at["mesher"] == (19, 19)
