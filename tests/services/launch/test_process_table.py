"""How long processes that end by themselves may take."""

import pytest

from hsslam_services.launch.process_table import MAP_SAVER, TRAJECTORY_SAVER, one_shot_timeout_s

_AN_HOUR = 30 * 3600  # frames


@pytest.mark.parametrize("hours", [1, 24, 7 * 24])
def test_the_time_for_the_trajectories_grows_with_the_run(hours):
    poses = hours * _AN_HOUR
    assert one_shot_timeout_s(TRAJECTORY_SAVER, poses) >= 60 + 10 * hours
    assert one_shot_timeout_s(MAP_SAVER, poses) == one_shot_timeout_s(MAP_SAVER, 0)
